"""Steps of tests/system/boot that read: what clients are told, by which camera and line, and how closed the device is."""
import csv
import re
import shutil
import statistics
import subprocess
import time

from pymodbus.client import ModbusSerialClient

import machine
from bench import (ANY_FAULT, CAMERA_FAULT, CAMERA_FPS, CAMERA_LOST, HELD, PACK, SESSION, SHAPE_VALID, SOURCE, TOUCH_VALID, WORK,
                   camera_settings, check, step)
from machine import READY
from register_block import Block, signed
from usb_camera import UsbCamera, read_images
from virtual_frames import YAML, write_frames, write_session

MEASURED = [*range(5, 20), 40, 41, 42]  # touch, force, deformation, top plate, contact
# Radius and deviation tell of more than one image: a finger that jumps from one to the next counts as shaken.
RADIUS, FORCE_DEVIATION = 8, 10
OF_ONE_IMAGE = [r for r in MEASURED if r not in (RADIUS, FORCE_DEVIATION)]
SHAPE = range(11, 20)
CLEAR_TOUCH = 230  # its radius at most, in 0.01 mm
ENOUGH_FRAMES = 80  # that are compared in a step
# The first frames after the recording begins again come from another shape than in the single replay.
NEW_SHAPE_FRAMES = 5
# Markers and plates follow the last ones, so images that a busy machine leaves out leave a trace in them. In the shape,
# which takes a fixed number of steps, it would be tenths of a millimetre; so there every frame is solved by itself.
SKIPPED_PICTURES_COUNTS = 5
MOST_LOST_AT_ONCE = 4  # images, between two blocks that are compared
STARTS = 3  # of which the medians are told: a busy moment of the workstation lengthens any part of a start
FRAME_BY_ITSELF = '[shape]\ntier = "map+newton"\n'


def start_moments(board):
    """When the guest's services began, ours among them, and when that was ready: seconds after its kernel began. And how
    long it is up."""
    _, said = board.shell("systemctl show -P UserspaceTimestampMonotonic; "
                          "systemctl show -P ExecMainStartTimestampMonotonic finsightd; "
                          "systemctl show -P ActiveEnterTimestampMonotonic finsightd; cut -d' ' -f1 /proc/uptime")
    *moments_us, up_s = (float(word) for word in said.split())
    return [moment / 1e6 for moment in moments_us] + [up_s]


def start_by_parts(board, firmware_s, answer_s):
    """Seconds of the way from power to the first answer, by the guest's clock, which begins with its kernel. The network:
    what passes between the moment in which the firmware would answer and that in which somebody reaches it."""
    services_s, ours_s, ready_s, up_s = start_moments(board)
    kernel_at = time.monotonic() - board.switched_on - up_s  # on our clock
    parts = {"firmware": firmware_s, "loader": kernel_at - firmware_s, "kernel": services_s,
             "services": ours_s - services_s, "ours": ready_s - ours_s, "network": answer_s - kernel_at - ready_s}
    return {name: round(seconds, 1) for name, seconds in parts.items()}


@step
def starts_and_answers(bench):
    """Power to the first valid Modbus answer, and to the first frame's registers."""
    bench.fresh_card('\n[source]\nspeed = "full"\n')
    starts = []
    for _ in range(STARTS):
        bench.machine.cut_power()
        bench.machine.start()
        firmware_s = bench.machine.wait_console("BdsDxe: starting")
        seconds, _ = bench.machine.wait_registers()
        starts.append({"all": round(seconds, 1), **start_by_parts(bench.machine, firmware_s, seconds)})
    parts = {name: statistics.median(start[name] for start in starts) for name in starts[0]}
    seconds = parts.pop("all")
    bench.measured.update(boot_s=seconds, boot_parts_s=parts, own_start_s=parts["ours"],
                          own_start_longest_s=max(start["ours"] for start in starts))
    ready, _ = bench.machine.wait_registers(lambda words: words[0] & READY)
    release = dict(line.split("=", 1) for line in bench.machine.shell("cat /usr/lib/finsight/release")[1].splitlines())
    bench.measured["version"] = release["version"]
    bench.measured["slot_mb"] = round((bench.update().stat().st_size - 4096) / 1e6, 1)
    return (f"first valid answer after {seconds:.1f} s ({parts}; medians of {STARTS} starts, the longest of finsightd "
            f"{bench.measured['own_start_longest_s']} s), first touch registers after {ready:.1f} s")


def workstation_replay(bench, more="", session=SESSION):
    """The workstation's registers of every frame of the session, shown once from the first to the last."""
    log, settings = WORK / "reference.csv", WORK / "reference.toml"
    settings.write_text(f'pack = "{PACK}"\n[source]\nkind = "session"\npath = "{session}"\nspeed = "full"\n'
                        f'[modbus]\nport = 0\n{more}')
    subprocess.run([bench.finsightd, "--settings", settings, "--registers", log], check=True, capture_output=True)
    with open(log, newline="") as file:
        return [tuple(int(word) for word in row) for row in list(csv.reader(file))[1:]]


def worst_difference(words, expected, registers=MEASURED):
    """In counts."""
    return max(abs(signed(words[r]) - signed(expected[r])) for r in registers)


def check_block(words, expected, frame, counts=1, registers=MEASURED):
    check(words[36:40] == expected[36:40], "model checksum, map version, constant")
    check((words[0] ^ expected[0]) & 0x00EF == 0, f"frame {frame}: status {words[0]:x}, not {expected[0]:x}")
    check(worst_difference(words, expected, registers) <= counts,
          f"frame {frame}: {words[5:20] + words[40:43]}, the workstation says {expected[5:20] + expected[40:43]}")


@step
def registers_are_the_workstations(bench):
    """Every frame's registers, read over the network, against the workstation's replay of the same session."""
    board = bench.running()
    reference = workstation_replay(bench)
    frames = len(reference)
    seen = {}
    end = time.monotonic() + 240 * board.slowness
    while len(seen) < ENOUGH_FRAMES and time.monotonic() < end:
        words = machine.read_registers(board.port)
        check(words, "the firmware answers while it works")
        k = Block(list(words)).frame % frames
        if words[0] & READY and k >= NEW_SHAPE_FRAMES:
            seen[k] = words
    check(len(seen) >= ENOUGH_FRAMES / 2, f"only {len(seen)} different frames were seen")
    for k, words in seen.items():
        check_block(words, reference[k], k)
    worst = max(worst_difference(words, reference[k]) for k, words in seen.items())
    return f"{len(seen)} frames compared, worst difference {worst} counts"


@step
def a_serial_master_reads_the_same(bench):
    """Modbus RTU through a USB adapter, by pymodbus and mbpoll, against what TCP says at the same time."""
    bench.fresh_card('\n[source]\nspeed = "full"\n[modbus.serial]\ndevice = "/dev/ttyUSB0"\nunit = 17\n')
    board = bench.machine
    board.start("-chardev", "pty,id=rtu", "-device", "usb-serial,chardev=rtu,always-plugged=on")
    board.wait_registers(lambda words: words[0] & READY)
    line = re.search(r"rtu: filename=pty:(\S+)", board.monitor("info chardev"))[1]
    # No parity at this end: a pseudo terminal has none, and Python's library insists on what it asked for.
    master = ModbusSerialClient(port=line, baudrate=19200, parity="N", timeout=10)
    check(master.connect(), f"{line} cannot be opened")
    frames = []
    for _ in range(20):
        before = Block(list(machine.read_registers(board.port))).frame
        answer = master.read_holding_registers(0, 48, slave=17)
        check(not answer.isError(), f"pymodbus: {answer}")
        after = Block(list(machine.read_registers(board.port))).frame
        block = Block(list(answer.registers))
        check(block.words[39] == machine.TEST_CONSTANT and not block.words[0] & ANY_FAULT, f"{block.words}")
        check(before <= block.frame <= after, f"frame {block.frame} over RTU, {before} to {after} over TCP around it")
        frames.append(block.frame)
    check(frames[0] < frames[-1], "the registers stand still")
    master.close()
    answer = subprocess.run(["mbpoll", "-m", "rtu", "-b", "19200", "-P", "none", "-a", "17", "-t", "3", "-r", "40", "-c",
                             "1", "-o", "5", "-1", line], capture_output=True, text=True)
    check(f"{machine.TEST_CONSTANT}" in answer.stdout, f"mbpoll: {answer.stdout}{answer.stderr}")
    bench.machine.cut_power()
    return f"{len(frames)} blocks by pymodbus on {line}, one by mbpoll"


FIFO, ORDINARY = 1, 0  # scheduling policies, as /proc has them


def scheduling_of_threads(lines):
    """Of the lines of every task's stat and its Cpus_allowed_list, in turn: [(id, name, policy, priority, processors)]."""
    threads = []
    for stat, allowed in zip(lines[::2], lines[1::2]):
        identity, rest = stat.split(" (", 1)
        name, rest = rest.rsplit(") ", 1)
        fields = rest.split()  # from the third on: proc(5)
        processors = set()
        for part in allowed.split(":")[1].strip().split(","):
            first, _, last = part.partition("-")
            processors.update(range(int(first), int(last or first) + 1))
        threads.append((int(identity), name, int(fields[41 - 3]), int(fields[40 - 3]), processors))
    return threads


def check_threads(board, priority=20, processor=1):
    """The frame loop's thread alone is real-time and has its processor to itself; how many other threads there are."""
    _, text = board.shell("pid=$(systemctl show -P MainPID finsightd); echo $pid; for task in /proc/$pid/task/*; do "
                          "cat $task/stat; grep Cpus_allowed_list $task/status; done")
    pid, *lines = text.splitlines()
    threads = scheduling_of_threads(lines)
    loop = [thread for thread in threads if thread[0] == int(pid)]
    check(len(loop) == 1 and loop[0][2:] == (FIFO, priority, {processor}), f"the loop's thread: {loop}")
    others = [thread for thread in threads if thread[0] != int(pid)]
    for thread in others:
        check(thread[2:4] == (ORDINARY, 0) and thread[4] - {processor}, f"scheduled like the loop: {thread} of {threads}")
    check(others, "the server has a thread of its own")
    return len(others)


@step
def is_closed_and_confined(bench):
    """No log-in, no port but the page's and Modbus', read-only system, own user, real time, locked memory, a low exposure."""
    board = bench.running()
    _, security = board.shell("cd /usr/lib/systemd/system; for unit in finsight*.service; do "
                              "systemd-analyze security ${unit/@./@x.} --no-pager | tail -n 1; done")
    scores = {name: float(score) for name, score in re.findall(r"level for (\S+): ([0-9.]+)", security)}
    check("finsightd.service" in scores and len(scores) >= 10, security)
    score = scores["finsightd.service"]
    bench.measured["security_score"] = score
    open_units = {name: value for name, value in scores.items() if value > 2.0}
    check(not open_units, f"systemd-analyze security says {open_units}")
    # The page starts after the sensor and has the lowest priority.
    _, tcp = board.shell("for i in $(seq 120); do grep -q ':0050 .* 0A ' /proc/net/tcp && break; sleep 1; done; tail -n +2 /proc/net/tcp /proc/net/tcp6 2>/dev/null | awk '$4 == \"0A\" { print $2 }'")
    check(sorted(tcp.split()) == ["00000000:0050", "00000000:01F6"], f"listening TCP sockets (page, Modbus): {tcp}")
    _, udp = board.shell("tail -qn +2 /proc/net/udp /proc/net/raw | awk '{ print $2 }'")
    mdns, dhcp = ":14E9", ":0044"
    check(all(line.endswith((mdns, dhcp)) for line in udp.split()), f"UDP and raw sockets: {udp}")
    _, users = board.shell("ps -eo user,comm 2>/dev/null || for p in /proc/[0-9]*; do stat -c %U $p; cat $p/comm; done")
    check("getty" not in users and "login" not in users, users)
    status, _ = board.shell("touch /usr/probe /etc/probe")
    check(status != 0, "the system can be written to")
    _, passwords = board.shell("cut -d: -f2 /etc/shadow | sort -u")
    check(passwords.strip() == "!*", f"passwords: {passwords}")
    _, process = board.shell("pid=$(systemctl show -P MainPID finsightd); stat -c %U /proc/$pid; chrt -p $pid; "
                             "taskset -p $pid; grep -E 'VmLck|CapEff|NoNewPrivs|Seccomp:' /proc/$pid/status")
    for wanted in ("finsight", "SCHED_FIFO", "priority: 20", "mask: 2", "CapEff:\t0000000000000000", "NoNewPrivs:\t1",
                   "Seccomp:\t2"):
        check(wanted in process, f"{wanted!r} is not in\n{process}")
    check(not re.search(r"VmLck:\s+0 kB", process), "memory is not locked")
    others = check_threads(board)
    _, setuid = board.shell("find / -xdev -perm /6000")
    check(not setuid.strip(), f"setuid files: {setuid}")
    return f"exposure {score}, of all our units at most {max(scores.values())}, {others} ordinary threads beside the loop's"


def output_levels(board):
    """Of contact, overload, healthy: "hi" or "lo"."""
    _, lines = board.shell("mount -t debugfs none /sys/kernel/debug 2>/dev/null; cat /sys/kernel/debug/gpio")
    ours = re.findall(r"\|\s*finsight\s*\) (\w+)\s+(\w+)", lines)
    check(len(ours) == 3 and all(direction == "out" for direction, _ in ours), lines)
    return [level for _, level in ours]


@step
def outputs_follow(bench):
    """The digital outputs are ours and say that the sensor is healthy."""
    return " ".join(output_levels(bench.running()))


@step
def a_hung_loop_is_restarted(bench):
    """A frame loop that stands still for its watchdog's time is replaced."""
    board = bench.running()
    _, before = board.shell("systemctl show -P MainPID finsightd")
    board.shell(f"kill -STOP {before.strip()}")
    end = time.monotonic() + 300 * board.slowness
    while time.monotonic() < end:
        _, now = board.shell("systemctl show -P MainPID finsightd")
        if now.strip() not in ("0", before.strip()):
            break
        time.sleep(2)
    check(now.strip() not in ("0", before.strip()), "the watchdog did not replace the stopped process")
    bench.frames_advance(300)
    check(board.times_logged("hardware watchdog") > 0, "no hardware watchdog in use")
    return ""


def virtual_camera_stick(images):
    """A stick with images as the virtual camera wants them, and its settings. What it makes of the images."""
    folder = WORK / "virtual"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    (folder / "virtual.yaml").write_text(YAML.format(folder="/usr/share/libcamera/images"))
    shown = write_frames(folder, images)
    machine.make_stick(WORK / "images.img", sorted(folder.iterdir()))
    return WORK / "images.img", shown


@step
def a_virtual_camera_is_read(bench):
    """libcamera's own virtual camera, in the board's libcamera, shows frames of the session."""
    # Of a faint touch the place answers by tenths of a millimetre to what lost images leave behind in the plates.
    touched = [k for k, words in enumerate(workstation_replay(bench))
               if words[0] & TOUCH_VALID and words[RADIUS] <= CLEAR_TOUCH]
    images = read_images(SESSION)[2]
    # More images than ImageCheck remembers: a camera that shows the same few again and again is frozen.
    stick, shown = virtual_camera_stick([images[k] for k in touched[::len(touched) // 6][:6]])
    write_session(WORK / "shown", SESSION, shown * 20)  # the last time with all that the others have left behind
    expected = workstation_replay(bench, FRAME_BY_ITSELF, WORK / "shown")[-len(shown):]
    bench.fresh_card(camera_settings() + FRAME_BY_ITSELF)
    board = bench.machine
    board.start()
    board.wait_registers(lambda words: words[1] == CAMERA_LOST)
    board.plug_stick(stick, "images")
    status, said = board.shell(
        "for i in $(seq 60); do [ -b /dev/sda ] && break; sleep 1; done; mkdir -p /run/images && "
        "mount -t vfat -o ro /dev/sda /run/images && mount -t tmpfs tmpfs /usr/share/libcamera && "
        "cd /usr/share/libcamera && mkdir -p pipeline/virtual images && cp /run/images/*.jpg images && "
        "cp /run/images/virtual.yaml pipeline/virtual && chmod -R a+rX . && cd / && systemctl restart finsightd")
    check(status == 0, said)
    board.wait_registers(lambda words: words[0] & TOUCH_VALID and not words[0] & ANY_FAULT)
    seen, blocks, worst, end = set(), 0, 0, time.monotonic() + 120 * board.slowness
    while (len(seen) < len(expected) or blocks < 20) and time.monotonic() < end:
        words = machine.read_registers(board.port)
        if words and words[0] & READY and not words[0] & (ANY_FAULT | HELD):
            k = min(range(len(expected)), key=lambda k: worst_difference(words, expected[k], OF_ONE_IMAGE))
            check_block(words, expected[k], k, SKIPPED_PICTURES_COUNTS, OF_ONE_IMAGE)
            worst = max(worst, worst_difference(words, expected[k], OF_ONE_IMAGE))
            blocks += 1
            seen.add(k)
    check(len(seen) == len(expected), f"only the images {seen} of {len(expected)} were seen")
    others = check_threads(board)  # libcamera's among them
    bench.machine.cut_power()
    return f"{blocks} blocks of {len(seen)} images as replayed, worst difference {worst} counts, {others} other threads"


def replay_as_of_a_camera(bench):
    """The workstation's registers of the session, of which it knows no more than a camera tells: neither that the first
    image shows the finger at rest nor how it hangs. The faintest touches are not told then."""
    shutil.copytree(SESSION, WORK / "camera", dirs_exist_ok=True)
    told = WORK / "camera/session.toml"
    told.write_text(re.sub(r"(?m)^(from_rest|gravity_g) = .*\n", "", told.read_text()))
    return workstation_replay(bench, FRAME_BY_ITSELF, WORK / "camera")


def is_withheld(words, expected):
    """Whether the board says no touch where the workstation does: with images lost the finger looks shaken."""
    return not words[0] & TOUCH_VALID and bool(expected[0] & TOUCH_VALID)


def camera_difference(words, expected):
    """In counts."""
    return worst_difference(words, expected, SHAPE if is_withheld(words, expected) else OF_ONE_IMAGE)


def images_of(blocks, reference, shift):
    """[(words, the workstation's words for that image)] of blocks by frame, and how many images were lost on the way.

    The first block shows the image `shift` after its frame's number. An emulator that gets too little of the processor loses
    one here and there, which no frame counts: from then on the shift is greater. A block that fits no image is taken for the
    one that is due. Twice the frames of a new shape are left out, because a busy machine comes to every second image only.
    """
    frames, pairs, first = len(reference), [], shift
    for frame, words in sorted(blocks.items()):
        due = [(frame + shift + lost) % frames for lost in range(MOST_LOST_AT_ONCE + 1)]
        fits = [camera_difference(words, reference[k]) <= SKIPPED_PICTURES_COUNTS for k in due]
        shift += fits.index(True) if True in fits else 0
        if (frame + shift) % frames >= 2 * NEW_SHAPE_FRAMES:
            pairs.append((words, reference[(frame + shift) % frames]))
    return pairs, shift - first


def compare_camera(board, reference):
    """Blocks of a camera that shows the session, each against the workstation's block of the same image."""
    seen = {}
    end = time.monotonic() + 240 * board.slowness
    while len(seen) < ENOUGH_FRAMES and time.monotonic() < end:
        words = machine.read_registers(board.port)
        check(words, "the firmware answers while it works")
        if words[0] & READY and not words[0] & (ANY_FAULT | HELD):
            seen[Block(list(words)).frame] = words
    check(len(seen) >= ENOUGH_FRAMES / 2, f"only {len(seen)} frames were seen")
    ways = [images_of(seen, reference, shift) for shift in range(len(reference))]
    misfits = lambda way: [pair for pair in way[0] if camera_difference(*pair) > SKIPPED_PICTURES_COUNTS]
    pairs, lost = best = min(ways, key=lambda way: (len(misfits(way)), way[1]))
    check(not misfits(best), f"{len(misfits(best))} of {len(pairs)} blocks differ:" + "".join(
        f"\n{words[:20] + words[40:43]}, the workstation says {expected[:20] + expected[40:43]}"
        for words, expected in misfits(best)[:3]))
    check(all(words[36:40] == expected[36:40] for words, expected in pairs), "model checksum, map version, constant")
    touches = sum(words[0] & TOUCH_VALID != 0 for words, _ in pairs)
    withheld = sum(is_withheld(*pair) for pair in pairs)
    worst = max(camera_difference(*pair) for pair in pairs)
    said = f"{len(pairs)} blocks ({touches} with a touch, {withheld} withheld) as replayed, worst difference {worst} counts, " \
           f"{lost} images lost"
    check(touches > len(pairs) / 3 and withheld + lost <= len(pairs) / 10, said)
    return said


@step
def a_usb_camera_is_seen_lost_and_found_again(bench):
    """A USB camera's registers are the workstation's; unplugged: fault 1, safe outputs; then again, at any port."""
    reference = replay_as_of_a_camera(bench)
    bench.fresh_card(camera_settings() + FRAME_BY_ITSELF)
    board = bench.machine
    board.start(*board.camera_port(), *board.camera_port("other"))
    with UsbCamera(board.folder / "camera.sock", SESSION, CAMERA_FPS) as camera:
        camera.plug()
        board.wait_registers(lambda words: words[0] & TOUCH_VALID and not words[0] & ANY_FAULT)
        said = compare_camera(board, reference)
        check_threads(board)
        _, process = board.shell("systemctl show -P MainPID finsightd")

        camera.unplug()
        pulled = time.monotonic()
        _, words = board.wait_registers(lambda words: words[0] & CAMERA_FAULT and not words[0] & (READY | HELD))
        lost_s = time.monotonic() - pulled
        check(words[1] == CAMERA_LOST and words[0] & ANY_FAULT, f"status {words[0]:x}, fault {words[1]}")
        check(not words[0] & (TOUCH_VALID | SHAPE_VALID), f"status {words[0]:x} with no camera")
        check(words[5] == 0x8000 and words[9] == 0xFFFF and words[14] == 0x8000, f"shown as measured: {words[5:20]}")
        levels = output_levels(board)
        check(levels == ["hi", "hi", "lo"], f"outputs with no camera: {levels}")

        camera.plug()
        plugged = time.monotonic()
        bench.frames_advance()
        found_s = time.monotonic() - plugged
        again = compare_camera(board, reference)
        check_threads(board)  # of the camera that was opened while the loop was running
        _, now = board.shell("systemctl show -P MainPID finsightd")
        _, log = board.shell("journalctl -b -o short-monotonic -n 40")
        check(now.strip() == process.strip(), f"the firmware was restarted:\n{log}")
    with UsbCamera(board.folder / "other.sock", SESSION, CAMERA_FPS) as elsewhere:
        board.wait_registers(lambda words: words[0] & CAMERA_FAULT)
        elsewhere.plug()
        bench.frames_advance()
    bench.machine.cut_power()  # the steps that follow want the session
    return f"{said}; lost after {lost_s:.1f} s, found after {found_s:.1f} s; {again}"


@step
def the_image_for_any_uefi_computer_reads_a_camera(bench):
    """generic-uefi-arm64 with the same model: a USB camera's registers are the workstation's there, too."""
    board = "generic-uefi-arm64"
    subprocess.run([SOURCE / "scripts/image", board, "--pack", PACK], check=True, stdout=subprocess.DEVNULL)
    reference = replay_as_of_a_camera(bench)
    image = next((SOURCE / "build/image" / board).glob("finsight-*.img"))
    bench.fresh_card(camera_settings() + FRAME_BY_ITSELF, image)
    bench.machine.start(*bench.machine.camera_port())
    with UsbCamera(bench.machine.folder / "camera.sock", SESSION, CAMERA_FPS) as camera:
        camera.plug()
        bench.machine.wait_registers(lambda words: words[0] & TOUCH_VALID and not words[0] & ANY_FAULT)
        said = compare_camera(bench.machine, reference)
        _, release = bench.machine.shell("cat /usr/lib/finsight/release")
        check(board in release, f"another image: {release}")
    bench.machine.cut_power()
    return said


@step
def wrong_settings_give_a_fault(bench):
    """A misspelt key: safe mode, fault 5 over Modbus, the line named; corrected, the sensor works again."""
    bench.fresh_card("\n[modbsu]\nport = 502\n")
    line = bench.default_settings.count("\n") + 2
    bench.machine.start()
    seconds, words = bench.machine.wait_registers()
    check(words[1] == 5 and words[0] == ANY_FAULT, f"status {words[0]:x}, fault {words[1]}")
    check(words[5] == 0x8000 and words[9] == 0xFFFF, "nothing is announced as measured")
    bench.machine.wait_console(f"finsight.toml:{line}: modbsu", 30)  # names file, line and key
    return f"fault 5 after {seconds:.1f} s"


@step
def a_full_disk_and_power_cuts_are_survived(bench):
    """The data partition is filled up, then the power goes in the middle of writing, three times."""
    bench.machine.cut_power()
    bench.running()
    board = bench.machine
    status, _ = board.shell("dd if=/dev/zero of=/data/recordings/huge bs=1M; sync")
    _, room = board.shell("df /data | tail -n 1")
    check("100%" in room, f"not full: {room}")
    bench.frames_advance()
    board.shell("rm /data/recordings/huge")
    identity = board.shell("cat /etc/machine-id")[1].strip()
    for _ in range(3):
        board.shell("(while true; do dd if=/dev/urandom of=/data/recordings/x bs=256k count=40 conv=fsync; "
                    "mv /data/recordings/x /data/recordings/y; done) >/dev/null 2>&1 &")
        time.sleep(4)
        board.cut_power()
        board.start()
        board.wait_registers(lambda words: words[0] & READY)
        _, mounts = board.shell("grep ' /data ' /proc/mounts")
        check(" rw," in mounts, f"/data: {mounts}")
        check(board.shell("cat /etc/machine-id")[1].strip() == identity, "the machine kept its identity")
    return ""
