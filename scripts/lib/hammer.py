"""Clients that give commands as fast as they are taken, each with numbers of its own choice: none may be told that a command
is done that did not run, and none may be lost. With pymodbus, for tests/system and scripts/lib/attack.py.
"""
import threading
import time

from pymodbus.client import ModbusTcpClient

from register_block import ADDRESS, VALUES

KEY = 18003
RUNNING = VALUES["history_1_result"]["running"]
COMMANDS = [VALUES["command"][name] for name in ("none", "clear", "clear_tare", "reset_peaks", "reset_events")]
HISTORY, ENTRIES, ENTRY = ADDRESS["commands_given"], 8, 5
HISTORY_WORDS = ADDRESS["history_8_client"] + 2 - HISTORY
BUSY, WRONG_VALUE = 6, 3


def connect(port, source):
    client = ModbusTcpClient("127.0.0.1", port=port, timeout=5, source_address=(source, 0))
    if not client.connect():
        raise ConnectionError(f"no Modbus server on port {port}")
    return client


def read(client, address, count):
    answer = client.read_holding_registers(address, count, slave=1)
    if answer.isError():
        raise ConnectionError(f"Modbus answered {answer}")
    return answer.registers


class Client(threading.Thread):
    """Takes the number after that of the last finished command or, every second client, after that of the last one given;
    both are what others take, too."""

    def __init__(self, number, port, until):
        super().__init__(daemon=True)
        self.port, self.until = port, until
        self.source = "127.0.0.1" if number % 2 else f"127.0.0.{10 + number}"
        self.after = ADDRESS["result_sequence" if number % 4 < 2 else "command_sequence"]
        self.next_command = number
        self.done, self.busy, self.used, self.problems = [], 0, 0, []

    def run(self):
        try:
            client = connect(self.port, self.source)
            while time.monotonic() < self.until:
                client.write_register(ADDRESS["write_key"], KEY, slave=1)
                for _ in range(50):
                    self.give(client)
            client.close()
        except Exception as error:  # whatever it is, the run has failed
            self.problems.append(f"{self.source}: {error!r}")

    def give(self, client):
        number = read(client, self.after, 1)[0] % 65535 + 1
        command = COMMANDS[self.next_command % len(COMMANDS)]
        answer = client.write_registers(ADDRESS["command"], [command, number], slave=1)
        if answer.isError():
            if answer.exception_code not in (BUSY, WRONG_VALUE):
                raise ConnectionError(f"Modbus answered {answer}")
            self.busy += answer.exception_code == BUSY
            self.used += answer.exception_code == WRONG_VALUE
            time.sleep(0.001)
            return
        self.next_command += 1
        deadline = time.monotonic() + 10
        while True:
            own = read(client, ADDRESS["own_sequence"], 3)
            if own[:2] != [number, command]:
                self.problems.append(f"{self.source}: gave {[number, command]}, reads {own} as its own")
                return
            if own[2] != RUNNING:
                break
            if time.monotonic() > deadline:
                self.problems.append(f"{self.source}: {[number, command]} did not end")
                return
        if own[2] != 0:
            self.problems.append(f"{self.source}: {[number, command]} ended with {own[2]}")
        self.done.append((number, command, self.source))


class Watcher(threading.Thread):
    """Notes every command in the history's list, in order."""

    def __init__(self, port):
        super().__init__(daemon=True)
        self.client = connect(port, "127.0.0.100")
        self.first = self.seen = read(self.client, HISTORY, 1)[0]
        self.ran, self.missed, self.stop = [], 0, False

    def run(self):
        while True:
            last = self.stop
            words = read(self.client, HISTORY, HISTORY_WORDS)
            new = (words[0] - self.seen) % 65536
            self.missed += max(new - ENTRIES, 0)
            for entry in reversed(range(min(new, ENTRIES))):
                at = ADDRESS["history_1_sequence"] - HISTORY + ENTRY * entry
                octets = words[at + 3].to_bytes(2, "big") + words[at + 4].to_bytes(2, "big")
                self.ran.append((words[at], words[at + 1], ".".join(map(str, octets))))
            self.seen = words[0]
            if last:
                return
            time.sleep(0.002)


def hammer(port, seconds, clients=8):
    """Figures, and what was wrong in sentences."""
    until = time.monotonic() + seconds
    watcher = Watcher(port)
    watcher.start()
    threads = [Client(number, port, until) for number in range(clients)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(seconds + 30)
    watcher.stop = True
    watcher.join(10)
    problems = [problem for thread in threads for problem in thread.problems]
    done = [command for thread in threads for command in thread.done]
    given = (watcher.seen - watcher.first) % 65536
    false_done = sum(max(done.count(command) - watcher.ran.count(command), 0) for command in set(done))
    lost = sum(max(watcher.ran.count(command) - done.count(command), 0) for command in set(watcher.ran))
    if given != len(done):
        problems.append(f"{given} commands were run, {len(done)} reported done")
    if watcher.missed == 0 and (false_done or lost):
        problems.append(f"{false_done} commands reported done did not run, {lost} that ran were not reported")
    figures = {"seconds": seconds, "clients": clients, "done": len(done), "run": given, "false_done": false_done,
               "lost": lost, "busy": sum(t.busy for t in threads), "number_used": sum(t.used for t in threads),
               "not_seen_in_list": watcher.missed}
    return figures, problems
