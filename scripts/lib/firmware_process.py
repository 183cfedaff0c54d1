"""Starts finsightd with a board file of its own and stops it again. For the soak run and the system tests."""
import random
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path


def free_port(count=1):
    """The first of `count` free ports in a row, below those that the system gives to outgoing connections: these come and go."""
    while True:
        first = random.randrange(20000, 32000)
        try:
            for port in range(first, first + count):
                with socket.socket() as probe:
                    probe.bind(("127.0.0.1", port))
            return first
        except OSError:
            pass


def session_source(path, speed="recorded", repeat="true"):
    """The keys of a board file's [source] that replays a session."""
    return f'kind = "session"\npath = "{path}"\nspeed = "{speed}"\nrepeat = {repeat}'


class Firmware:
    """A running finsightd; the end of a `with` block stops it. `source` holds the keys of [source], and whatever follows."""

    def __init__(self, finsightd, pack, source, extra_arguments=(), first_line=""):
        self.port = free_port()
        self.folder = tempfile.TemporaryDirectory()
        settings = Path(self.folder.name) / "board.toml"
        settings.write_text(f'{first_line}\npack = "{pack}"\n[source]\n{source}\n[modbus]\nport = {self.port}\n')
        self.process = subprocess.Popen([finsightd, "--settings", settings, *extra_arguments],
                                        stderr=subprocess.PIPE, text=True)

    def __enter__(self):
        return self

    def __exit__(self, error=None, *_):
        self.process.send_signal(signal.SIGTERM)
        self.errors = self.process.communicate(timeout=10)[1]
        if error:
            print(self.errors[-2000:], file=sys.stderr)
        self.folder.cleanup()
