"""Steps of tests/system/boot: how the device is found, whose key it has, and how its story is got out of it."""
import gzip
import json
import re
import socket
import subprocess
import tarfile
import time
import urllib.request

from zeroconf import const

import machine
from bench import ANY_FAULT, WORK, check, step
from boot_reads import start_moments
from boot_updates import stick_made_by
from exfat_stick import files_on_exfat, make_exfat_stick
from local_link import LocalLink
from machine import COUNTING, READY, Machine

REPORT_REQUEST = "finsight-report.txt"
FULL_SPEED = '\n[source]\nspeed = "full"\n'
IMAGE_MADE, IMAGE_SLOT = 3122, 3124  # registers


def get(board, path, host, limit_s=60):
    """Of the page, which starts after the sensor and has the lowest priority."""
    request = urllib.request.Request(f"http://127.0.0.1:{board.page_port}{path}", headers={"Host": host})
    end = time.monotonic() + limit_s * board.slowness
    while True:
        try:
            with urllib.request.urlopen(request, timeout=20) as answer:
                body = answer.read()
                return gzip.decompress(body) if answer.headers["Content-Encoding"] == "gzip" else body
        except OSError:
            if time.monotonic() > end:
                raise
            time.sleep(1)


@step
def is_found_by_name_where_nobody_gives_out_addresses(bench):
    """A cable without a DHCP server: a link-local address, name and services by multicast DNS; console; the page."""
    bench.fresh_card(FULL_SPEED)
    board = bench.machine
    with LocalLink() as link:
        board.start(*link.device())
        board.wait_registers(lambda words: words[0] & READY)
        limit_s = 60 * board.slowness
        found = {service: link.ask(f"{service}.local.", const._TYPE_PTR, limit_s)[0].alias
                 for service in ("_modbus._tcp", "_http._tcp")}
        name = found["_modbus._tcp"].split(".")[0]
        serial = board.identity()["serial"]
        check(name == f"finsight-{serial}".lower(), f"announced: {found}, serial number {serial}")
        addresses = [socket.inet_ntoa(record.address) for record in link.ask(f"{name}.local.", const._TYPE_A, limit_s)]
        check(any(address.startswith("169.254.") for address in addresses), f"addresses of {name}: {addresses}")
        ports = {service: link.ask(found[service], const._TYPE_SRV, limit_s)[0].port for service in found}
        check(ports == {"_modbus._tcp": 502, "_http._tcp": 80}, f"{ports}")
    board.wait_console(f"serial number {serial}, {name}.local, addresses: .*169\\.254\\.", 60)
    board.wait_console(f"write key {board.identity()['write_key']}", 60)
    page = get(board, "/", f"{name}.local")
    state = json.loads(get(board, "/api/state", f"{name}.local"))
    check(b"<html" in page and state["serial_number"] == serial, state.get("serial_number"))
    _, slot = board.shell("cat /run/finsight/image")
    version, slot = slot.split()
    words = machine.read_registers(board.port, 3, address=IMAGE_MADE)
    check(words[0] << 16 | words[1] == int(version[-10:]), f"{words} is not {version}")
    check(words[2] == 1 and slot == "a", f"slot: {words[2]}, {slot}")
    board.cut_power()
    return f"{name}.local at {', '.join(addresses)}; page of {len(page)} bytes"


def unlocks(board, key):
    """Whether this key is taken, by mbpoll."""
    done = subprocess.run(["mbpoll", "-m", "tcp", "-p", str(board.port), "-0", "-r", "1004", "-t", "4", "-o", "10", "-1",
                           "127.0.0.1", "--", str(key)], capture_output=True, text=True)
    said = done.stdout + done.stderr
    check(done.returncode == 0 or "Illegal data value" in said, said)
    return done.returncode == 0


@step
def every_device_has_its_own_key(bench):
    """Two cards: two keys, neither the workstation's; the same one after a power cut; a board file's instead."""
    keys = []
    for _ in range(2):
        bench.fresh_card(FULL_SPEED)
        board = bench.machine
        board.start()
        board.wait_registers(lambda words: words[0] & READY)
        keys.append(int(board.identity()["write_key"]))
        check(unlocks(board, keys[-1]), f"key {keys[-1]} is not taken")
    check(len(set(keys)) == 2 and 18003 not in keys, f"keys: {keys}")
    check(not unlocks(board, 18003), "the workstation's key is taken")
    board.cut_power()
    machine.write_settings(bench.card, bench.default_settings.replace("[modbus]\n", "[modbus]\nwrite_key = 4711\n") + FULL_SPEED)
    board.start()
    board.wait_registers(lambda words: words[0] & READY)
    check(board.identity()["write_key"] == "4711", "the console would show another key than the settings'")
    check(unlocks(board, 4711), "the settings' key is not taken")
    check(not unlocks(board, keys[-1]), "the device's own key is taken, too")
    check(board.shell("cat /data/identity/write-key")[1].strip() == str(keys[-1]), "the key did not survive the power cut")
    board.cut_power()
    return ""


def files_on(stick):
    """Of a stick's root: name -> bytes."""
    listing = subprocess.run(["mdir", "-b", "-i", stick, "::/"], capture_output=True, text=True).stdout.split()
    names = [name.removeprefix("::/") for name in listing]
    return {name: subprocess.run(["mtype", "-i", stick, f"::/{name}"], capture_output=True, check=True).stdout
            for name in names}


def make_fat_stick(stick):
    request = WORK / REPORT_REQUEST
    request.write_text("please\n")
    machine.make_stick(stick, [request])


def ask_by_stick(bench, make=make_fat_stick, files=files_on):
    """What is on a stick that `make` formats with a request for the report, once the device has seen it."""
    handled = bench.machine.times_logged("Finished finsight-stick")
    stick = stick_made_by(bench, make)
    end = time.monotonic() + 120 * bench.machine.slowness
    while bench.machine.times_logged("Finished finsight-stick") <= handled:
        check(time.monotonic() < end, "the stick was not looked at")
        time.sleep(1)
    bench.machine.pull_stick()
    time.sleep(2)
    return files(stick)


@step
def a_stick_gets_the_report(bench):
    """A stick that asks gets log, settings, registers, versions; the first one also the key, which is nowhere else on it."""
    board = bench.running_afresh()
    board.wait_up()
    key = board.identity()["write_key"]
    files = ask_by_stick(bench)
    check(f"write_key={key}" in files.get("finsight-key.txt", b"").decode(), f"on the stick: {list(files)}")
    report = WORK / "report.tar.gz"
    report.write_bytes(files["finsight-diagnostics.tar.gz"])
    with tarfile.open(report) as tar:
        parts = {name.split("/", 1)[1]: tar.extractfile(name).read() for name in tar.getnames() if tar.getmember(name).isfile()}
    for wanted in ("log.txt", "release", "board.toml", "finsight.toml", "system.txt", "page.tar"):
        check(parts.get(wanted), f"{wanted} is missing or empty; there are {list(parts)}")
    check(b"finsightd: Modbus TCP" in parts["log.txt"], "the firmware's words are missing in the log")
    for name, content in parts.items():
        check(not re.search(rb"\bkey\D{1,3}" + key.encode() + rb"\b", content), f"the key is in {name}")
    again = ask_by_stick(bench)
    check("finsight-key.txt" not in again and "finsight-diagnostics.tar.gz" in again, f"the second time: {list(again)}")
    bench.frames_advance()
    return f"{len(parts)} files, {len(files['finsight-diagnostics.tar.gz']) // 1024} kB"


@step
def an_exfat_stick_gets_the_report(bench):
    """The same with a stick that has exFAT, as large ones have when they are bought."""
    board = bench.running()
    board.wait_up()
    files = ask_by_stick(bench, lambda stick: make_exfat_stick(stick, [REPORT_REQUEST]), files_on_exfat)
    check(REPORT_REQUEST in files and files.get("finsight-diagnostics.tar.gz", b"")[:2] == b"\x1f\x8b", f"on the stick: {list(files)}")
    bench.frames_advance()
    return f"{len(files['finsight-diagnostics.tar.gz']) // 1024} kB"


@step
def the_log_survives_a_power_cut(bench):
    """What was said 30 s before the power went is there after the next start."""
    board = bench.running()
    mark = f"said-{time.monotonic_ns()}"
    board.shell(f"echo {mark} | systemd-cat -t test")
    time.sleep(30)
    board.cut_power()
    board.start()
    board.wait_registers(lambda words: words[0] & READY)
    check(board.times_logged(mark, "-b -1 -t test") == 1, "it is not in the log of the start before")
    board.wait_registers(lambda words: not words[0] & ANY_FAULT, since_now=True)
    return ""


@step
def instructions_of_a_frame(bench):
    """How many instructions our start and a frame take: an emulator whose clock advances by a nanosecond with each."""
    bench.fresh_card("\n[realtime]\ncpu = 0\n")
    board = Machine(bench.card, WORK / "counting", cpu=COUNTING)
    with board:
        board.start()
        board.wait_registers(lambda words: words[0] & READY)
        _, ours_s, ready_s, _ = start_moments(board)
        time.sleep(30 * board.slowness)
        times_us = json.loads(get(board, "/api/diagnostics", "127.0.0.1"))["stage_times_us"]
    counts = {stage: round(times["p50"] / 1000, 2) for stage, times in times_us.items()}
    bench.measured["frame_million_instructions"] = counts
    # A Cortex-A72 retires about one of such instructions in a cycle (three at best); a Raspberry Pi 4's runs at 1.8 GHz.
    estimate_ms = round(counts["frame"] / 1.8, 2)
    bench.measured["a72_frame_ms_estimated"] = estimate_ms
    # On one processor, so what other services do meanwhile counts too.
    start_million = round(1000 * (ready_s - ours_s))
    bench.measured.update(own_start_million_instructions=start_million, a72_own_start_s_estimated=round(start_million / 1800, 2))
    return (f"{counts} million; about {estimate_ms} ms on a Cortex-A72 of 1.8 GHz at one in a cycle (an estimate), "
            f"our start {start_million} million")
