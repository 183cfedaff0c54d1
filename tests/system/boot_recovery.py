"""Steps of tests/system/boot in which the device must come back by itself."""
import re
import shutil
import subprocess
import time

from pymodbus.client import ModbusSerialClient

import machine
from bench import ANY_FAULT, CAMERA_FPS, CAMERA_LOST, SESSION, WORK, camera_settings, check, step
from machine import READY
from usb_camera import UsbCamera

FAILED_REPEATEDLY = 6  # register 1
RECORDING, RECORDING_FULL = 1, 3  # register 1005
FULL_SPEED = '\n[source]\nspeed = "full"\n'
ENV_AT_MIB, DATA_AT_MIB = 65, 450
SLOT_AT_MIB = {"a": 66, "b": 258}
RECORD_AT = 8192  # in the boot loader's partition
TELLS = "-comp", "lzo", "-Xalgorithm", "lzo1x_1", "-all-root", "-quiet", "-no-progress"


def kill_firmware(board, times, name="finsightd"):
    """As soon as it runs again, so many times."""
    last = ""
    for _ in range(times):
        _, said = board.shell(f"for i in $(seq 600); do pid=$(systemctl show -P MainPID {name}); "
                              f'[ "$pid" -gt 0 ] && [ "$pid" != "{last}" ] && break; sleep 0.1; done; kill -9 $pid; echo $pid')
        last = said.split()[-1]


@step
def firmware_and_safe_mode_alternate(bench):
    """Killed four times: safe mode; after its five minutes the firmware, again and again."""
    board = bench.running()
    came_back_s = []
    for _ in range(2):
        kill_firmware(board, 4)
        board.wait_registers(lambda words: words[1] == FAILED_REPEATEDLY, since_now=True)
        began = time.monotonic()
        board.wait_registers(lambda words: not words[0] & ANY_FAULT and words[0] & READY, since_now=True, limit_s=600)
        came_back_s.append(round(time.monotonic() - began))
        _, both = board.shell("systemctl is-active finsightd finsight-safe; true")
        check(both.split() == ["active", "inactive"], f"firmware and safe mode: {both}")
    return f"out of safe mode after {came_back_s} s"


@step
def safe_mode_that_is_killed_or_stopped_comes_back(bench):
    """Safe mode killed, and stopped: the device answers again; ended by a signal that asks: the firmware, too."""
    bench.fresh_card("\n[modbsu]\n")
    board = bench.machine
    board.start()
    board.wait_registers(lambda words: words[1] == 5)
    for signal in ("KILL", "STOP", "TERM"):
        _, pid = board.shell("systemctl show -P MainPID finsight-safe")
        board.shell(f"kill -{signal} {pid}")
        board.wait_new_process("finsight-safe", pid, limit_s=120)
        board.wait_registers(lambda words: words[1] == 5, since_now=True)
    board = bench.running_afresh()
    _, pid = board.shell("systemctl show -P MainPID finsightd")
    board.shell(f"kill -TERM {pid}")
    board.wait_new_process("finsightd", pid, limit_s=60)
    bench.frames_advance()
    return ""


def sick_system(slot, program="usr/bin/finsightd", text="#!/bin/sh\nexit 1\n"):
    """A system in which one program is another, by default a firmware that ends at once; everything else in it works."""
    root, sick = WORK / "sick", WORK / "sick.squashfs"
    shutil.rmtree(root, ignore_errors=True)
    (WORK / "slot").write_bytes(slot)
    subprocess.run(["unsquashfs", "-q", "-n", "-d", root, WORK / "slot"], check=True, capture_output=True)
    (root / program).unlink()
    (root / program).write_text(text)
    (root / program).chmod(0o755)
    sick.unlink(missing_ok=True)
    subprocess.run(["mksquashfs", root, sick, *TELLS], check=True, capture_output=True)
    return sick


def damage(card, at, content):
    with open(card, "r+b") as file:
        file.seek(at)
        file.write(content)


def put_into_slot(card, slot, file):
    subprocess.run(["dd", f"if={file}", f"of={card}", "bs=1M", f"seek={SLOT_AT_MIB[slot]}", "conv=notrunc", "status=none"],
                   check=True)


def ends_in_slot_b(board):
    board.start()
    seconds, _ = board.wait_registers(lambda words: words[0] & READY, limit_s=1800)
    _, line = board.shell("cat /proc/cmdline")
    check("finsight.slot=b" in line, line)
    starts = board.console().count("BdsDxe: starting")
    return f"slot b answers after {starts} starts and {seconds:.0f} s"


@step
def a_broken_system_is_left_for_the_other_slot(bench):
    """The slot that was always healthy has a firmware that ends at once, safe mode too: the other slot starts."""
    bench.fresh_card(FULL_SPEED)
    put_into_slot(bench.card, "a", sick_system(bench.update().read_bytes()[4096:]))
    return ends_in_slot_b(bench.machine)


@step
def a_broken_system_is_left_though_the_boot_record_is_damaged(bench):
    """The boot loader can neither read nor write its record, and takes the slot whose firmware ends at once."""
    bench.fresh_card(FULL_SPEED)
    put_into_slot(bench.card, "a", sick_system(bench.update().read_bytes()[4096:]))
    damage(bench.card, (ENV_AT_MIB << 20) + RECORD_AT, bytes(1024))
    return ends_in_slot_b(bench.machine)


@step
def a_start_that_hangs_is_left_for_the_other_slot(bench):
    """A slot in which the start waits for ever, before any unit of ours; it has one start left."""
    bench.fresh_card(FULL_SPEED)
    put_into_slot(bench.card, "a", sick_system(bench.update().read_bytes()[4096:], "usr/bin/systemd-tmpfiles",
                                               "#!/bin/sh\nexec sleep infinity\n"))
    record = b"# GRUB Environment Block\nslot=a\nleft=i\nspare=1\ntrial=0\n".ljust(1024, b"#")
    damage(bench.card, (ENV_AT_MIB << 20) + RECORD_AT, record)
    return ends_in_slot_b(bench.machine)


@step
def a_data_partition_beyond_repair_is_made_afresh(bench):
    """Its first half overwritten: the device measures, and what it keeps outlives the next start."""
    bench.fresh_card(FULL_SPEED)
    damage(bench.card, DATA_AT_MIB << 20, b"\xA5" * (32 << 20))
    board = bench.machine
    ids = []
    for _ in range(2):
        board.start()
        board.wait_registers(lambda words: words[0] & READY)
        status, said = board.shell("grep -q ' /data ' /proc/mounts && cat /data/machine-id && stat -c %U /data/recordings")
        check(status == 0 and said.split()[1] == "finsight", f"status {status}: {said}")
        ids.append(said.split()[0])
        board.shell("sync")
        board.cut_power()
    check(ids[0] == ids[1], f"machine ids {ids}")
    return ""


@step
def another_card_in_a_usb_reader_is_not_started(bench):
    """The same partitions under the same names, with a firmware that ends at once, plugged in when the power comes."""
    bench.fresh_card(FULL_SPEED)
    reader = WORK / "reader.img"
    machine.copy_card(bench.card, reader)
    put_into_slot(reader, "a", sick_system(bench.update().read_bytes()[4096:]))
    board = bench.machine
    board.start("-drive", f"if=none,id=reader,format=raw,file={reader}", "-device", "usb-storage,drive=reader")
    board.wait_registers(lambda words: words[0] & READY)
    _, said = board.shell("readlink -f /dev/finsight/slot-a; readlink -f /dev/finsight/data; cat /proc/partitions")
    check(said.split()[:2] == ["/dev/vda3", "/dev/vda5"] and "sda3" in said, said)
    board.cut_power()
    return ""


@step
def outputs_wait_for_their_rights(bench):
    """The chip of the output lines gets its rights only a while after the firmware's start: it waits."""
    board = bench.running()
    before = board.times_logged("SAFE MODE", "-b -u finsight-safe")
    board.shell("chown root:root /dev/gpiochip0; chmod 600 /dev/gpiochip0; "
                "systemctl restart --no-block finsightd; sleep 5; chgrp gpio /dev/gpiochip0; chmod 660 /dev/gpiochip0")
    bench.frames_advance()
    now = board.times_logged("SAFE MODE", "-b -u finsight-safe")
    check(now == before, f"times in safe mode: {before} before, {now} after")
    return ""


@step
def a_check_refuses_what_the_start_would(bench):
    """finsightd --check on the board: processors and lines that it does not have."""
    board = bench.running()
    for text, reason in (("[realtime]\\ncpu = 200", "cpu: found 200"),
                         ('[gpio]\\nhealthy = { number = 99 }', "no line 99"),
                         ('[gpio]\\nchip = "/dev/gpiochip7"', "/dev/gpiochip7"),
                         ('[network]\\nmethod = "static"\\naddress = "127.0.0.1/8"', "network.address"), ("", None)):
        status, said = board.shell(f"printf '{text}\\n' >/tmp/user.toml; finsightd --settings /usr/lib/finsight/board.toml "
                                   "--user /tmp/user.toml --check 2>&1")
        check((status == 2 and reason in said) if reason else status == 0, f"{text}: status {status}, {said}")
    return ""


@step
def a_recording_that_fills_the_disk_stays(bench):
    """Recorded until nothing more fits: the recording is complete, and tidying up leaves it."""
    bench.fresh_card(FULL_SPEED + "[storage]\nrecord_reserve_mb = 0\n")
    board = bench.machine
    board.start()
    board.wait_registers(lambda words: words[0] & READY)
    bench.order("record")
    end = time.monotonic() + 300 * board.slowness
    while (state := machine.read_registers(board.port, 1, address=1005)[0]) == RECORDING:
        check(time.monotonic() < end, "the disk does not become full")
        time.sleep(1)
    check(state == RECORDING_FULL, f"recording: {state}")
    status, said = board.shell("systemctl start finsight-trim; cat /data/recordings/session-0001/session.toml; "
                               "stat -c %s /data/recordings/session-0001/frames.y4m")
    check(status == 0 and "complete = false" not in said and int(said.split()[-1]) > 20e6, said)
    bench.frames_advance()
    bench.machine.cut_power()
    return f"{int(said.split()[-1]) / 1e6:.0f} MB"


@step
def a_camera_and_an_adapter_that_come_late_work(bench):
    """A start without either; then both are plugged in: frames, and Modbus RTU answers."""
    bench.fresh_card(camera_settings() + '[modbus.serial]\ndevice = "/dev/ttyUSB0"\nunit = 17\n')
    board = bench.machine
    board.start(*board.camera_port())
    board.wait_registers(lambda words: words[1] == CAMERA_LOST)
    board.wait_up()
    with UsbCamera(board.folder / "camera.sock", SESSION, CAMERA_FPS) as camera:
        plugged = time.monotonic()
        camera.plug()
        board.monitor("chardev-add pty,id=rtu")
        board.monitor("device_add usb-serial,id=adapter,chardev=rtu,always-plugged=on")
        bench.frames_advance()
        frames_s = time.monotonic() - plugged
        line = re.search(r"rtu: filename=pty:(\S+)", board.monitor("info chardev"))[1]
        master = ModbusSerialClient(port=line, baudrate=19200, parity="N", timeout=2)
        check(master.connect(), f"{line} cannot be opened")
        while True:
            answer = master.read_holding_registers(0, 48, slave=17)
            answer_s = time.monotonic() - plugged
            if not answer.isError():
                break
            check(answer_s < 60 * board.slowness, f"pymodbus: {answer}")
        check(answer.registers[39] == machine.TEST_CONSTANT, answer.registers)
        master.close()
    limit_s = 5 * board.slowness
    check(frames_s < limit_s, f"frames only after {frames_s:.1f} s, more than {limit_s:.1f}")
    board.cut_power()
    return f"frames after {frames_s:.1f} s, the serial line answers after {answer_s:.1f} s"
