"""finsightd and finsight-page on one board file, for the page's tests."""
import http.client
import json
import signal
import socket
import subprocess
import tempfile
import time
from pathlib import Path

from end_to_end import BINARIES, PACK, SESSION, SPEC, session_source
from firmware_process import free_port

KEY = 18003


def render(folder, *words, spec=SPEC):
    newest = max((BINARIES / "hostgen").stat().st_mtime, spec.stat().st_mtime)
    if not folder.exists() or folder.stat().st_mtime < newest:
        subprocess.run([BINARIES / "hostgen", "render", spec, "-o", folder, "--size", "640x480", *words], check=True)


class Device:
    """Both programs; the end of a `with` block stops them. `fingers`: [[finger]] tables instead of a finger with `path`."""

    def __init__(self, path=SESSION, more="", page_prefix=(), fingers=""):
        self.folder = tempfile.TemporaryDirectory()
        self.port, self.page_port = free_port(), free_port(8)  # every finger's page has a port of its own
        self.settings = Path(self.folder.name) / "board.toml"
        one = "" if fingers else f'pack = "{PACK}"\n[source]\n{session_source(path=path)}\n'
        self.settings.write_text(
            f'{one}[modbus]\nport = {self.port}\n'
            '[storage]\nsettings = "state.toml"\nrecordings = "recordings"\n'
            f'[page]\nport = {self.page_port}\nfolder = "memory"\nmeasured = "measured"\n{more}\n{fingers}')
        self.firmware = self.page = None
        self.page_prefix = page_prefix

    def __enter__(self):
        try:
            self.start_firmware()
            self.start_page()
            self.wait(lambda: self.get("/api/state")[1].get("status"), "a state")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        for process in (self.page, self.firmware):
            if process and process.poll() is None:
                process.send_signal(signal.SIGTERM)
        for process in (self.page, self.firmware):
            if process:
                try:
                    process.wait(20)
                except subprocess.TimeoutExpired:
                    process.kill()
                    raise
        self.folder.cleanup()

    def start_firmware(self):
        self.firmware = self.start("finsightd", "Modbus TCP on")

    def start_page(self):
        self.page = self.start("finsight-page", "http://", self.page_prefix)

    def start(self, program, ready, prefix=()):
        """What it says goes into a file: a pipe that nobody reads stops the program once it is full."""
        with open(self.log(program), "w") as log:
            process = subprocess.Popen([*prefix, BINARIES / program, "--settings", self.settings], stderr=log)
        until = time.monotonic() + 40
        while ready not in self.log(program).read_text():
            if process.poll() is not None or time.monotonic() > until:
                process.kill()
                raise AssertionError(f"{program} is not ready (code {process.wait()}):\n{self.log(program).read_text()}")
            time.sleep(0.02)
        return process

    def log(self, program):
        return Path(self.folder.name) / f"{program}.log"

    @property
    def url(self):
        return f"http://127.0.0.1:{self.page_port}/"

    def request(self, method, path, body=None, headers=None, timeout=10):
        """Status, header fields, bytes."""
        connection = http.client.HTTPConnection("127.0.0.1", self.page_port, timeout=timeout)
        try:
            connection.request(method, path, body, headers or {})
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read()
        finally:
            connection.close()

    def get(self, path):
        status, _, body = self.request("GET", path)
        return status, json.loads(body)

    def post(self, path, body, token="", **headers):
        fields = {"Content-Type": "application/json", "X-Finsight-Token": token, **headers}
        status, _, answer = self.request("POST", path, body if isinstance(body, (str, bytes)) else json.dumps(body), fields)
        return status, json.loads(answer)

    def unlock(self):
        status, answer = self.post("/api/unlock", {"key": KEY})
        assert status == 200, answer
        return answer["token"]

    def raw(self):
        return socket.create_connection(("127.0.0.1", self.page_port), timeout=30)

    def wait(self, is_there, what, seconds=40):
        """On a busy machine things take their time."""
        deadline = time.monotonic() + seconds
        while True:
            try:
                if found := is_there():
                    return found
            except (OSError, http.client.HTTPException, ValueError):
                pass
            assert time.monotonic() < deadline, f"no {what} within {seconds} s; " + "".join(
                f"{program}: {self.log(program).read_text()[-2000:]}" for program in ("finsightd", "finsight-page"))
            time.sleep(0.1)

    def order(self, command, token):
        """Its result, as the history has it."""
        status, answer = self.post("/api/command", {"command": command}, token)
        assert status == 200, answer

        def result():
            state = self.get("/api/state")[1]
            for n in range(1, 9):
                if state[f"history_{n}_sequence"] == answer["sequence"] and state[f"history_{n}_result"] != "running":
                    return state[f"history_{n}_result"]
            return None
        return self.wait(result, f"result of {command}")

    def memory_kb(self):
        """Resident memory of the page's program."""
        for line in Path(f"/proc/{self.page.pid}/status").read_text().splitlines():
            if line.startswith("VmRSS"):
                return int(line.split()[1])
        return 0
