"""Steps of tests/system/boot about sticks and updates."""
import random
import shutil
import subprocess
import time

import machine
from bench import WORK, check, step
from boot_recovery import sick_system
from exfat_stick import make_exfat_stick

COPIED = "held nothing that works and is now a copy of this one"  # the slot that was left, from then on a spare again


def stick_made_by(bench, make):
    """Instead of the one that is plugged in; `make` writes its image."""
    bench.machine.pull_stick()
    time.sleep(2)
    stick = WORK / "stick.img"
    make(stick)
    bench.machine.plug_stick(stick)
    return stick


def stick_with(bench, file):
    return stick_made_by(bench, lambda stick: machine.make_stick(stick, [file]))


def state_of(board):
    """What no stick may change: the firmware's process, the boot loader's record, the boot partition, what is mounted."""
    return board.shell("systemctl show -P MainPID finsightd; . /usr/lib/finsight/slots; set +e; slots_get slot; slots_get left; "
                       "slots_get spare; dd if=/dev/vda1 bs=1M status=none | sha256sum; grep -c /run/finsight /proc/mounts; "
                       "cat /proc/sys/kernel/random/boot_id")[1]


def sticks_handled(board):
    return board.times_logged("(Finished|Failed to start|Condition check.*) finsight-(stick|update)@")


def stick_is_read(board):
    """Now. It ends by itself after twenty minutes, if not before."""
    return board.shell("systemctl list-units --state=activating --no-legend 'finsight-stick@*'")[1].strip() != ""


def fat_stick(files, free_mib=48):
    machine.make_stick(WORK / "attack.img", files, free_mib)


def attack_file(name, content=b"finsight-update=1\nhello\n"):
    file = WORK / "attack" / name
    file.write_bytes(content)
    return file


def a_link(_):
    """On a file system that has links: the answer would be written over the boot partition."""
    tree = WORK / "attack" / "tree"
    tree.mkdir()
    (tree / "finsight-update.txt").symlink_to("/dev/vda1")
    (tree / "finsight-x.update").write_bytes(b"hello")
    subprocess.run(["/usr/sbin/mke2fs", "-q", "-t", "ext4", "-d", tree, WORK / "attack.img", "32M"], check=True)


def a_huge_file(_):
    fat_stick([attack_file("finsight-x.update", b"finsight-update=1\n" + bytes(300 << 20))])


def thousands_of_files(_):
    make_exfat_stick(WORK / "attack.img", [f"finsight-{k}.update" for k in range(5000)])


def folders_instead_of_files(_):
    fat_stick([attack_file("finsight-x.update")])
    subprocess.run(["mmd", "-i", WORK / "attack.img", "::/finsight-update.txt", "::/finsight-y.update"], check=True)


def a_full_stick(_):
    fat_stick([attack_file("finsight-x.update")], 40)
    subprocess.run("dd if=/dev/zero of=full bs=1M count=80 status=none; mcopy -i ../attack.img full ::/ 2>/dev/null || true",
                   cwd=WORK / "attack", shell=True, check=True)


def names_with_newlines(_):
    """Which mtools refuses to write, so the name is changed on the stick, where it stands in pieces of UTF-16."""
    fat_stick([attack_file("finsight-WWWWWWWWWWWWWWWWWWWWWW.update")])
    content = (WORK / "attack.img").read_bytes()
    check(b"W\0W\0" in content, "no long name on the stick")
    (WORK / "attack.img").write_bytes(content.replace(b"W\0W\0", b"\n\0\x1b\0"))


def harm(chance, boot_sectors):
    """Random bytes in tables and folders, which are all that is in the first megabytes, but not in what says where they are."""
    with open(WORK / "attack.img", "r+b") as file:
        content = bytearray(file.read(5 << 20))
        used = [at for at in range(512 * boot_sectors, len(content)) if content[at]]
        for at in chance.sample(used, len(used) // 20):
            content[at] = chance.randrange(256)
        file.seek(0)
        file.write(content)


def a_damaged_fat(chance):
    fat_stick([attack_file(f"finsight-{k}.update", chance.randbytes(5000)) for k in range(30)])
    harm(chance, 1)


def a_damaged_exfat(chance):
    thousands_of_files(chance)
    harm(chance, 24)


@step
def hostile_sticks_change_nothing(bench):
    """Links, huge files, thousands of files, folders, a full stick, strange names, damaged file systems."""
    board = bench.running()
    board.wait_up()
    before = state_of(board)
    chance = random.Random(20)
    attacks = [a_link, a_huge_file, thousands_of_files, folders_instead_of_files, a_full_stick, names_with_newlines,
               *[a_damaged_fat, a_damaged_exfat] * 3]
    for attack in attacks:
        shutil.rmtree(WORK / "attack", ignore_errors=True)
        (WORK / "attack").mkdir()
        attack(chance)
        handled = sticks_handled(board)
        board.plug_stick(WORK / "attack.img")
        wait = 10 if attack in (a_link, a_damaged_fat, a_damaged_exfat) else 300  # these need not be looked at
        end = time.monotonic() + wait * board.slowness
        while sticks_handled(board) <= handled and (time.monotonic() < end or stick_is_read(board)):
            time.sleep(1)
        check(wait == 10 or sticks_handled(board) > handled, f"{attack.__name__}: the stick was not looked at")
        after = state_of(board)
        check(after == before, f"{attack.__name__}: before\n{before}\nafter\n{after}")
        board.pull_stick()
        time.sleep(2)
    bench.frames_advance()
    return f"{len(attacks)} sticks"


def stick_says(stick):
    answer = subprocess.run(["mtype", "-i", stick, "::/finsight-update.txt"], capture_output=True, text=True)
    return answer.stdout


def wait_for_stick(board, stick, limit_s=900):
    end = time.monotonic() + limit_s * board.slowness
    while time.monotonic() < end:
        if stick_says(stick):
            return stick_says(stick)
        time.sleep(1)
    raise TimeoutError("the stick was not looked at")


@step
def updates_are_checked(bench):
    """An update that somebody changed, that is signed by somebody else, or for another board is refused."""
    board = bench.running()
    board.wait_up()
    good = bench.update().read_bytes()
    other_key = WORK / "other-key.pem"
    subprocess.run(["openssl", "genpkey", "-algorithm", "ed25519", "-out", other_key], check=True)
    changed = bytearray(good)
    changed[len(good) // 2] ^= 1
    file = WORK / "finsight-x.update"
    cases = [("is damaged", lambda: file.write_bytes(changed)),
             ("signature", lambda: machine.make_update(file, good[4096:8192], other_key, "qemu-virt", "x", "x")),
             ("for board rpi4", lambda: machine.make_update(file, good[4096:8192], bench.key, "rpi4", "x", "x")),
             ("is not complete", lambda: file.write_bytes(good[:len(good) // 2]))]
    for reason, make in cases:
        make()
        said = wait_for_stick(board, stick_with(bench, file))
        check(reason in said, f"expected '{reason}', the stick says: {said}")
    _, slot = board.shell(". /usr/lib/finsight/slots; slots_get slot; slots_get left")
    check(slot.split() == ["a", "iiiiiiii"], slot)
    bench.frames_advance()
    return ""


@step
def an_update_is_installed_and_a_sick_one_left_again(bench):
    """A good update starts from the other slot; one whose firmware does not work is given up by itself."""
    board = bench.running()
    board.wait_up()
    slot_a = bench.update().read_bytes()[4096:]
    file = WORK / "finsight-x.update"
    machine.make_update(file, slot_a, bench.key, "qemu-virt", "again", "another id")
    stick = stick_with(bench, file)
    check("starts next" in wait_for_stick(board, stick), stick_says(stick))
    wait_slot(board, "b")
    board.wait_up()
    sick = sick_system(slot_a)
    machine.make_update(file, sick.read_bytes(), bench.key, "qemu-virt", "sick", "sick")
    stick = stick_with(bench, file)
    check("starts next" in wait_for_stick(board, stick), stick_says(stick))
    # Slot a's console says so. It starts again within a minute, so a shell may never find it.
    board.wait_console("this version does not work here: back to the one before", 1800)
    wait_slot(board, "b")
    bench.frames_advance(300)
    board.wait_console(f"slot a {COPIED}", 900)
    _, sums = board.shell("for s in a b; do dd if=/dev/finsight/slot-$s bs=1M iflag=direct status=none | sha256sum; done", 300)
    check(len(set(sums.split()[::2])) == 1, sums)
    return ""


def wait_slot(board, slot, limit_s=900):
    """Until the console of a later start says that this slot runs; then until it answers."""
    end = time.monotonic() + limit_s * board.slowness
    while time.monotonic() < end:
        try:
            if board.shell("cat /proc/cmdline", 60)[1].find(f"finsight.slot={slot}") >= 0:
                return
        except (OSError, ValueError):
            pass
        time.sleep(2)
    raise TimeoutError(f"slot {slot} did not start:\n" + board.console()[-2000:])
