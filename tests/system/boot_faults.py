"""Faults at random, a step of tests/system/boot: after each the device must answer over Modbus within its stated time.

A fault is a function that does its harm and gives the time, in seconds of an idle workstation, in which the device must
measure again (or report the fault that was made). Power cuts lose what was written last: the card's writes are logged by
QEMU and played again up to any one of them, of which only the first sectors arrive.
"""
import random
import struct
import time

import machine
from bench import ANY_FAULT, CAMERA_FPS, CAMERA_LOST, SESSION, WORK, camera_settings, check, step
from boot_found import get
from boot_recovery import DATA_AT_MIB, ENV_AT_MIB, FULL_SPEED, RECORD_AT, SLOT_AT_MIB, damage, sick_system
from boot_updates import COPIED, stick_with, wait_for_stick, wait_slot
from machine import READY
from usb_camera import UsbCamera

SECTOR = 512
DISCARD = 4  # flag of an entry without data
SHORT = 10  # faults in the step, when no time is given
START_S = 90  # power to measuring, with room for a repaired file system
CAMERA_S = 5  # plugged in to measuring
SETTINGS_REFUSED = 5  # register 1


def play_writes(before, log, card, chance):
    """The card as a power cut leaves it that loses the writes after a random one, and the end of that one."""
    entries, at = [], SECTOR
    content = log.read_bytes()
    while at + SECTOR <= len(content):
        sector, count, flags, _ = struct.unpack_from("<4Q", content, at)
        at += SECTOR
        if count and not flags & DISCARD:
            entries.append((sector, content[at:at + count * SECTOR]))
            at += count * SECTOR
    machine.copy_card(before, card)
    # Most of the harm is in the last writes; some cuts lose nearly all.
    lost = int(chance.expovariate(1 / 30)) if chance.random() < 0.8 else chance.randrange(len(entries) or 1)
    last = max(0, len(entries) - 1 - lost)
    with open(card, "r+b") as file:
        for k, (sector, data) in enumerate(entries[:last + 1]):
            if k == last:
                data = data[:SECTOR * chance.randrange(len(data) // SECTOR + 1)]
            file.seek(sector * SECTOR)
            file.write(data)
    return len(entries), last


class Faults:
    def __init__(self, bench, seed):
        self.bench, self.board, self.chance = bench, bench.machine, random.Random(seed)
        self.before, self.log = WORK / "before.img", WORK / "writes.log"

    def start(self, *more):
        machine.copy_card(self.bench.card, self.before)
        self.log.write_bytes(b"")
        self.board.write_log = self.log
        self.board.start(*more)

    def start_with(self, settings, *more):
        self.board.cut_power()
        machine.write_settings(self.bench.card, settings)
        self.start(*more)

    def flash(self):
        self.board.cut_power()
        self.bench.fresh_card(FULL_SPEED)
        self.start()
        self.wait()

    def wait(self, limit_s=900, accept=lambda words: words[0] & READY and not words[0] & ANY_FAULT):
        return self.board.wait_registers(accept, limit_s, since_now=True)[0]

    def signal(self, unit, name):
        self.board.shell(f"kill -{name} $(systemctl show -P MainPID {unit})")

    # The faults.

    def firmware_killed(self):
        self.signal("finsightd", "KILL")
        return 15

    def firmware_stopped(self):
        self.signal("finsightd", "STOP")
        return 60  # systemd's watchdog waits for 30 s

    def page_killed(self):
        self.signal("finsight-page", "KILL")
        get(self.board, "/api/about", "127.0.0.1", 60)
        return 5

    def page_stopped(self):
        self.signal("finsight-page", "STOP")
        get(self.board, "/api/about", "127.0.0.1", 90)  # its watchdog waits for 60 s
        return 5

    def name_service_stopped(self):
        self.signal("finsight-mdns", "STOP")
        end = time.monotonic() + 240 * self.board.slowness  # the guard comes by every minute, three after the start
        while "stopped" in self.board.shell("grep State /proc/$(systemctl show -P MainPID finsight-mdns)/status")[1]:
            check(time.monotonic() < end, "the name service is still stopped")
            time.sleep(2)
        return 5

    def network_daemon_killed(self):
        self.signal("systemd-networkd", "KILL")
        return 15

    def journal_killed(self):
        self.signal("systemd-journald", "KILL")
        return 10

    def out_of_memory(self):
        self.board.shell("(tail /dev/zero >/dev/null 2>&1 || true)", 600)
        return 30

    def serial_adapter_comes_and_goes(self):
        self.board.monitor("chardev-add null,id=fault")
        self.board.monitor("device_add usb-serial,id=fault,chardev=fault,always-plugged=on")
        time.sleep(self.chance.uniform(0, 5))
        self.board.monitor("device_del fault")
        time.sleep(2)
        self.board.monitor("chardev-remove fault")
        return 5

    def camera_comes_and_goes(self):
        """With a camera instead of the session; afterwards the session again."""
        self.start_with(self.bench.default_settings + camera_settings(), *self.board.camera_port())
        with UsbCamera(self.board.folder / "camera.sock", SESSION, CAMERA_FPS) as camera:
            camera.plug()
            self.wait()
            for _ in range(3):
                camera.unplug()
                self.wait(15, lambda words: words[1] == CAMERA_LOST)
                time.sleep(self.chance.uniform(0, 10))
                camera.plug()
                self.wait(CAMERA_S)
        self.start_with(self.bench.default_settings + FULL_SPEED)
        return START_S

    def disk_full(self):
        self.board.shell("dd if=/dev/zero of=/data/recordings/huge bs=1M; sync", 600)
        self.firmware_killed()
        seconds = self.wait(60)
        self.board.shell("rm -f /data/recordings/huge")
        return 15 + seconds

    def power_cut(self):
        time.sleep(self.chance.uniform(0, 10))
        self.board.cut_power()
        self.start()
        return START_S

    def power_cut_with_lost_and_torn_writes(self):
        self.board.shell("(while true; do dd if=/dev/urandom of=/data/recordings/x bs=64k count=20 conv=fsync; "
                         "mv /data/recordings/x /data/recordings/y; done) >/dev/null 2>&1 &")
        time.sleep(self.chance.uniform(0, 10))
        self.board.cut_power()
        play_writes(self.before, self.log, self.bench.card, self.chance)
        self.start()
        return START_S

    def power_cut_at_the_start(self):
        self.board.cut_power()
        self.start()
        time.sleep(self.chance.uniform(0, START_S * self.board.slowness))
        self.board.cut_power()
        play_writes(self.before, self.log, self.bench.card, self.chance)
        self.start()
        return START_S

    def running_system_corrupted(self):
        """Of the slot that runs, model pack included; the other one is whole."""
        slot = "a" if "finsight.slot=a" in self.board.shell("cat /proc/cmdline")[1] else "b"
        self.board.cut_power()
        size = self.bench.update().stat().st_size - 4096
        for _ in range(200):
            at = (SLOT_AT_MIB[slot] << 20) + self.chance.randrange(1 << 20, size)
            damage(self.bench.card, at, self.chance.randbytes(64))
        self.start()
        # Several starts, and the other slot's bytes are compared before it is taken.
        self.board.wait_console(COPIED, 900)
        return START_S

    def boot_record_damaged(self):
        """Or the file system that the boot loader finds it in."""
        self.board.cut_power()
        at = (ENV_AT_MIB << 20) + self.chance.choice((0, RECORD_AT))
        damage(self.bench.card, at, self.chance.randbytes(self.chance.choice((64, 1024))))
        self.start()
        return START_S

    def data_partition_damaged(self):
        self.board.cut_power()
        for _ in range(self.chance.choice((1, 200))):
            at = (DATA_AT_MIB << 20) + self.chance.randrange(32 << 20)
            damage(self.bench.card, at, self.chance.randbytes(4096))
        self.start()
        return START_S

    def bad_settings(self):
        text = bytearray((self.bench.default_settings + FULL_SPEED).encode())
        for _ in range(20):
            text[self.chance.randrange(len(text))] = self.chance.randrange(1, 256)
        self.start_with(bytes(text))
        # Some of it may still be valid; nothing answers on another port than the card's.
        self.wait(START_S * 2, lambda words: words[1] == SETTINGS_REFUSED or words[0] & READY)
        self.start_with(self.bench.default_settings + FULL_SPEED)
        return START_S

    def foreign_update(self):
        self.board.wait_up()
        file = WORK / "finsight-x.update"
        file.write_bytes(self.chance.randbytes(100_000))
        wait_for_stick(self.board, stick_with(self.bench, file), 300)
        return 5

    def good_update(self):
        self.board.wait_up()
        slot = "b" if "finsight.slot=a" in self.board.shell("cat /proc/cmdline")[1] else "a"
        file = WORK / "finsight-x.update"
        machine.make_update(file, self.bench.update().read_bytes()[4096:], self.bench.key, "qemu-virt", "again",
                            f"{self.chance.random()}")
        wait_for_stick(self.board, stick_with(self.bench, file))
        wait_slot(self.board, slot)
        self.board.wait_up()
        return START_S

    def sick_update(self):
        self.board.wait_up()
        slot = "a" if "finsight.slot=a" in self.board.shell("cat /proc/cmdline")[1] else "b"
        file = WORK / "finsight-x.update"
        sick = sick_system(self.bench.update().read_bytes()[4096:])
        machine.make_update(file, sick.read_bytes(), self.bench.key, "qemu-virt", "sick", f"{self.chance.random()}")
        said = self.board.console().count(COPIED)
        wait_for_stick(self.board, stick_with(self.bench, file))
        self.board.wait_console(f"(?s)({COPIED}.*){{{said + 1}}}", 1800)
        wait_slot(self.board, slot)
        return START_S

    SLOW = (camera_comes_and_goes, good_update, sick_update)  # minutes each: not in the short form
    ALL = (firmware_killed, firmware_stopped, page_killed, page_stopped, name_service_stopped, network_daemon_killed,
           journal_killed, out_of_memory, serial_adapter_comes_and_goes, camera_comes_and_goes, disk_full, power_cut,
           power_cut_with_lost_and_torn_writes, power_cut_at_the_start, running_system_corrupted, boot_record_damaged,
           data_partition_damaged, bad_settings, foreign_update, good_update, sick_update)


@step
def faults_at_random(bench):
    """Draws from kills, stops, out of memory, power cuts that lose writes, damaged systems, bad settings, updates."""
    faults = Faults(bench, bench.seed)
    faults.flash()
    end = time.monotonic() + 60 * bench.fault_minutes
    injected, failed, worst_s = 0, [], 0.0
    while time.monotonic() < end if bench.fault_minutes else injected < SHORT:
        choice = faults.chance.choice([fault for fault in Faults.ALL if bench.fault_minutes or fault not in Faults.SLOW])
        injected += 1
        try:
            limit_s = choice(faults)
            seconds = faults.wait(limit_s)
            worst_s = max(worst_s, seconds)
            print(f"       fault {injected}: {choice.__name__}: measures again after {seconds:.1f} s", flush=True)
        except Exception as error:
            failed.append(f"{injected}: {choice.__name__}: {error}")
            print(f"       fault {injected}: {choice.__name__}: {error}", flush=True)
            faults.flash()
    bench.machine.cut_power()
    bench.machine.write_log = None
    bench.measured["faults"] = {"injected": injected, "recovered": injected - len(failed), "worst_s": round(worst_s, 1),
                                "seed": bench.seed}
    check(not failed, f"{len(failed)} of {injected}: {failed}")
    return f"{injected} faults, worst {worst_s:.1f} s"
