#!/usr/bin/python3
"""finsight-page's interface for programs, and what it does against misuse; the measuring program does not notice any of it.

usage: page_attacks.py BINARY_DIR SOURCE_DIR [unittest arguments]
"""
import http.client
import io
import json
import os
import random
import re
import signal
import socket
import statistics
import subprocess
import tarfile
import tempfile
import threading
import time
import unittest
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from end_to_end import BINARIES, SOURCE, WORK, prepare  # and scripts/lib is in the path from here on
from page_device import KEY, Device, render
from register_block import Reader

REST = WORK / "rest"


class Interface(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.device = Device().__enter__()
        cls.addClassCleanup(cls.device.__exit__)

    def test_the_state_is_what_a_modbus_client_reads(self):
        answer = subprocess.run(["mbpoll", "-m", "tcp", "-t", "3", "-r", "1", "-c", "85", "-1", "-p", str(self.device.port), "127.0.0.1"],
                                capture_output=True, text=True, timeout=60)
        words = [int(line.split()[1]) & 0xFFFF for line in answer.stdout.splitlines() if line.startswith("[")]
        state = self.device.get("/api/state")[1]
        self.assertEqual(state["test_constant"], 0x1234)
        self.assertEqual(state["test_constant_long"], 0x12345678)
        self.assertEqual(state["map_version"], words[38])
        self.assertEqual(state["model_checksum"], words[36] << 16 | words[37])
        # The page may have read it half a second before mbpoll did, or any time after.
        self.assertLess((state["heartbeat"] - words[2] + 600) % 65536, 60 * 60)
        self.assertIn("ready", state["status"])

    def test_picture_and_shape_come_while_somebody_watches(self):
        status, headers, _ = self.device.request("GET", "/frame.jpg")
        if status == 503:
            self.device.wait(lambda: self.device.request("GET", "/frame.jpg")[0] == 200, "picture")
        _, headers, jpeg = self.device.request("GET", "/frame.jpg")
        self.assertEqual(headers["Content-Type"], "image/jpeg")
        self.assertEqual(jpeg[:3], b"\xff\xd8\xff")
        about = self.device.get("/api/about")[1]
        points = len(about["surface"]["rest_mm"]) // 3
        shape = self.device.wait(lambda: (lambda a: a[2] if a[0] == 200 else None)(self.device.request("GET", "/shape.bin")), "shape")
        self.assertEqual(len(shape), 6 * points)
        self.assertLess(max(about["surface"]["triangles"]), points)
        self.assertEqual([m["id"] for m in about["markers"]], [0, 1, 2])

    def test_events_come_one_after_the_other_each_whole(self):
        with self.device.raw() as stream:
            stream.sendall(f"GET /api/events HTTP/1.1\r\nHost: 127.0.0.1:{self.device.page_port}\r\nConnection: close\r\n\r\n".encode())
            answer = http.client.HTTPResponse(stream)
            answer.begin()
            self.assertEqual(answer.headers["Content-Type"], "text/event-stream")
            numbers, blocks, exposures = [], [], []
            while len(numbers) < 60 or len(blocks) < 3:
                line = answer.readline()
                if line == b"event: frame\n":
                    frame = json.loads(answer.readline().removeprefix(b"data: "))
                    numbers.append(frame["n"])
                    exposures.append(frame["t_ms"])
                elif line == b"event: registers\n":
                    blocks.append(json.loads(answer.readline().removeprefix(b"data: ")))
        self.assertEqual(numbers, sorted(set(numbers)))
        self.assertEqual([len(block["measurements"]) for block in blocks], [85] * len(blocks))
        self.assertEqual({block["error"] for block in blocks}, {""})
        # By the device's own clock, and a median, as a busy machine may pause: 10 to 20 events a second.
        apart_ms = statistics.median(b - a for a, b in zip(exposures, exposures[1:]))
        self.assertTrue(50 <= apart_ms <= 100, apart_ms)

    def test_one_address_leaves_places_for_the_events_of_others_and_hears_why_it_gets_none(self):
        ask = f"GET /api/events HTTP/1.1\r\nHost: 127.0.0.1:{self.device.page_port}\r\n\r\n".encode()

        def connect(address="127.0.0.3"):
            return socket.create_connection(("127.0.0.1", self.device.page_port), timeout=10, source_address=(address, 0))
        streams = [connect() for _ in range(8)]
        answers = []
        for stream in streams:
            stream.sendall(ask)
            answers.append(stream.recv(4096))
        self.assertEqual([b" 200 " in answer[:20] for answer in answers], [True] * 6 + [False] * 2)
        for answer in answers[6:]:
            self.assertIn(b" 503 ", answer[:20])
            self.assertIn(b"Too many pages of this device are open on your computer", answer)
        with connect("127.0.0.2") as other:
            other.sendall(ask)
            self.assertIn(b" 200 ", other.recv(4096)[:20])
        for stream in streams:
            stream.close()

        def has_place():
            with connect() as stream:
                stream.sendall(ask)
                return b" 200 " in stream.recv(4096)[:20]
        self.device.wait(has_place, "place after the others have gone")

    def test_metrics_are_prometheus_text(self):
        _, headers, body = self.device.request("GET", "/metrics")
        self.assertIn("version=0.0.4", headers["Content-Type"])
        for line in body.decode().splitlines():
            if not line.startswith("#"):
                name, value = line.rsplit(" ", 1)
                self.assertRegex(name, r'^finsight_[a-zA-Z0-9_]+(\{bit="[a-z_]+"\})?$')
                float(value)

    def test_settings_are_changed_as_a_whole_or_not_at_all(self):
        token = self.device.unlock()
        before = self.device.get("/api/export")[1]["settings"]
        # Both thresholds cross their old place.
        self.assertEqual(self.device.post("/api/settings", {"contact_on": 0.05, "contact_off": 0.03}, token)[0], 200)
        status, answer = self.device.post("/api/settings", {"hold_time": 300, "contact_off": 0.5}, token)
        self.assertEqual(status, 409)
        self.assertIn("exception 3", answer["error"])
        for wrong in ({"hold_time": 20000}, {"hold_time": 0.4}, {"word_order": 0.7}, {"hold_time": "x"}, {"after_hold": "maybe"}, {"nonsense": 1}, {"hold_time": None}, {}):
            self.assertEqual(self.device.post("/api/settings", wrong, token)[0], 400, wrong)
        now = self.device.get("/api/export")[1]["settings"]
        self.assertEqual((now["contact_on"], now["contact_off"], now["hold_time"]), (0.05, 0.03, before["hold_time"]))
        self.assertEqual(self.device.post("/api/settings", before, token)[0], 200)

    def test_a_recording_is_made_downloaded_and_deleted(self):
        token = self.device.unlock()
        self.assertEqual(self.device.order("record", token), "done")
        time.sleep(1)
        self.assertEqual(self.device.order("stop", self.device.unlock()), "done")
        name = self.device.get("/api/recordings")[1]["sessions"][0]["name"]
        status, _, body = self.device.request("GET", f"/api/recordings/{name}.tar")
        self.assertEqual(status, 200)
        with tarfile.open(fileobj=io.BytesIO(body)) as tar:
            self.assertIn(f"{name}/frames.y4m", tar.getnames())
            self.assertIn(f"{name}/session.toml", tar.getnames())
        self.assertEqual(self.device.post("/api/recordings/delete", {"name": name}, self.device.unlock())[0], 200)
        self.assertEqual(self.device.get("/api/recordings")[1]["sessions"], [])

    def test_a_recording_that_runs_is_not_deleted_however_long_the_measuring_program_hangs(self):
        token = self.device.unlock()
        self.assertEqual(self.device.order("record", token), "done")
        session = self.device.wait(lambda: self.device.get("/api/recordings")[1]["sessions"], "recording")[0]["name"]
        frames = Path(self.device.folder.name) / "recordings" / session / "frames.y4m"
        self.device.firmware.send_signal(signal.SIGSTOP)
        self.device.wait(frames.exists, "pictures")
        os.utime(frames, (0, 0))  # as old as after any pause
        status, answer = self.device.post("/api/recordings/delete", {"name": session}, self.device.unlock())
        self.device.firmware.send_signal(signal.SIGCONT)
        self.assertEqual(status, 503, answer)
        self.device.wait(lambda: self.device.get("/api/state")[1].get("recording") == "recording", "state")
        self.assertEqual(self.device.post("/api/recordings/delete", {"name": session}, self.device.unlock())[0], 409)
        self.assertEqual(self.device.order("stop", self.device.unlock()), "done")
        self.assertTrue(frames.exists())
        self.device.wait(lambda: self.device.get("/api/recordings")[1]["sessions"][0]["complete"], "end of the recording")
        self.assertEqual(self.device.post("/api/recordings/delete", {"name": session}, self.device.unlock())[0], 200)

    def test_a_download_whose_recording_is_deleted_breaks_instead_of_looking_whole(self):
        session = Path(self.device.folder.name) / "recordings" / "session-0099"
        session.mkdir(parents=True)
        (session / "frames.y4m").write_bytes(b"x" * 50_000_000)
        (session / "session.toml").write_text("complete = true\n")
        connection = http.client.HTTPConnection("127.0.0.1", self.device.page_port, timeout=30)
        connection.request("GET", "/api/recordings/session-0099.tar")
        answer = connection.getresponse()
        answer.read(1000)
        self.assertEqual(self.device.post("/api/recordings/delete", {"name": "session-0099"}, self.device.unlock())[0], 200)
        with self.assertRaises(http.client.IncompleteRead):
            answer.read()
        connection.close()

    def test_a_picture_without_the_board_is_rejected_with_the_reason_and_can_be_removed(self):
        def settled():
            lens = self.device.get("/api/lens")[1]
            return None if lens["is_busy"] else lens
        self.device.wait(lambda: self.device.request("GET", "/frame.jpg")[0] == 200, "picture")
        self.assertEqual(self.device.post("/api/lens/capture", {}, self.device.unlock())[0], 200)
        lens = self.device.wait(settled, "picture of the board")
        self.assertNotEqual(lens["views"][0]["rejected"], "")
        self.assertNotIn("result", lens)
        self.assertEqual(self.device.post("/api/lens/use", {}, self.device.unlock())[0], 409)
        self.assertEqual(self.device.post("/api/lens/restore", {}, self.device.unlock())[0], 409)
        for unknown in (-5, lens["views"][0]["id"] + 1, lens["views"][0]["id"] + (1 << 32), 1 << 63):
            self.assertEqual(self.device.post("/api/lens/remove", {"id": unknown}, self.device.unlock())[0], 404, unknown)
        self.assertEqual(self.device.post("/api/lens/remove", {"id": lens["views"][0]["id"]}, self.device.unlock())[0], 200)
        self.assertEqual(self.device.wait(settled, "removal")["views"], [])
        self.assertIn(b"<svg", self.device.request("GET", "/api/lens/board.svg")[2][:200])


class LiveLens(unittest.TestCase):
    def test_the_board_in_front_of_the_camera_gives_its_lens_and_the_former_one_can_be_brought_back(self):
        folder = WORK / "board"
        subprocess.run([BINARIES / "tests" / "board_session", folder], check=True)
        with Device(folder) as device:
            def lens_in_use():
                return device.get("/api/about")[1].get("lens", {}).get("fx", 0)  # none while it restarts

            def result():
                lens = device.get("/api/lens")[1]
                if lens["is_busy"]:
                    return None
                if len([view for view in lens["views"] if not view["rejected"]]) >= 10 and "result" in lens:
                    return lens["result"]
                device.post("/api/lens/capture", {"only_still": True}, device.unlock())
                return None
            self.assertEqual(lens_in_use(), 457)
            found = device.wait(result, "lens", 240)
            self.assertAlmostEqual(found["lens"][0], 490.7, delta=5)
            self.assertLess(found["rms_px"], 0.2)
            for path in ("use", "use", "restore"):  # what the first one replaced stays the former one
                device.wait(lambda: device.post(f"/api/lens/{path}", {}, device.unlock())[0] == 200, path)  # busy while it restarts
                if path == "use":
                    device.wait(lambda: abs(lens_in_use() - 490.7) < 5, "restart with the lens")
            device.wait(lambda: lens_in_use() == 457, "restart with the former lens")
            self.assertEqual(device.post("/api/lens/restore", {}, device.unlock())[0], 200)
            device.wait(lambda: abs(lens_in_use() - 490.7) < 5, "restart with the measured lens again")


class Updates(unittest.TestCase):
    """A file that is put down by the page and judged by the image's own scripts."""

    def setUp(self):
        self.spool = tempfile.TemporaryDirectory()
        self.addCleanup(self.spool.cleanup)
        self.updates = Path(self.spool.name)
        (self.updates / "spool").mkdir()
        self.device = Device(REST, f'updates = "{self.updates}"').__enter__()
        self.addCleanup(self.device.__exit__)

    def send(self, content, token, length=None, kind="application/octet-stream"):
        status, _, answer = self.device.request("POST", "/api/update/file", content, {
            "Content-Type": kind, "X-Finsight-Token": token, **({"Content-Length": str(length)} if length else {})})
        return status, json.loads(answer)

    def test_an_unsigned_file_arrives_whole_is_refused_by_the_updater_and_the_page_says_why(self):
        content = os.urandom(3_000_001)
        self.assertEqual(self.device.get("/api/update")[1]["state"], "none")
        self.assertEqual(self.send(content, self.device.unlock()), (200, {"done": True}))
        whole = self.updates / "spool" / "upload.update"
        self.assertEqual(whole.read_bytes(), content)
        self.assertEqual(self.device.get("/api/update")[1]["state"], "installing")
        self.assertEqual(self.send(content[:1000], self.device.unlock())[0], 409)
        state = self.updates / "state"
        state.mkdir()
        (state / "up").touch()
        image = SOURCE / "boards" / "image" / "rootfs" / "usr"
        environment = {**os.environ, "FINSIGHT_LIB": str(image / "lib" / "finsight"), "FINSIGHT_STATE": str(state),
                       "FINSIGHT_UPDATE": str(image / "sbin" / "finsight-update")}
        installed = subprocess.run(["sh", image / "lib" / "finsight" / "read-upload", self.updates], env=environment, capture_output=True,
                                   text=True, timeout=60)
        self.assertEqual(installed.returncode, 2, installed.stderr)
        whole.unlink()  # as the unit does afterwards, whatever came of it
        outcome = self.device.get("/api/update")[1]
        self.assertEqual(outcome["state"], "refused")
        self.assertIn("not a Finsight update", outcome["text"])

    def test_what_may_not_or_cannot_be_sent_is_refused_and_leaves_nothing(self):
        token = self.device.unlock()
        self.assertEqual(self.send(b"x" * 100, "0" * 32)[0], 401)
        self.assertEqual(self.send(b"x" * 100, token, kind="application/json")[0], 415)
        before = self.device.memory_kb()
        with self.device.raw() as connection:
            head = ("POST /api/update/file HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/octet-stream\r\n"
                    f"X-Finsight-Token: {token}\r\n")
            connection.sendall(f"{head}Content-Length: {1 << 40}\r\n\r\nx".encode())
            self.assertIn(b" 413 ", connection.recv(4096))
        with self.device.raw() as connection:
            connection.sendall(f"{head}Content-Length: 50000000\r\n\r\n".encode() + b"x" * 20_000_000)
            self.device.wait(lambda: self.device.get("/api/update")[1]["state"] == "receiving", "file that is being received")
        self.device.wait(lambda: self.device.get("/api/update")[1]["state"] == "none", "end of it")
        self.assertEqual(list((self.updates / "spool").iterdir()), [])
        self.assertLess(self.device.memory_kb(), before + 20_000)

    def test_a_workstation_says_that_it_has_no_updates(self):
        with Device(REST) as device:
            self.assertEqual(device.get("/api/update")[1]["available"], False)
            status, _, answer = device.request("POST", "/api/update/file", b"x", {
                "Content-Type": "application/octet-stream", "X-Finsight-Token": device.unlock()})
            self.assertEqual(status, 409, answer)


class Diagnostics(unittest.TestCase):
    def test_one_file_holds_state_log_export_and_the_last_bad_pictures(self):
        with Device(WORK / "covered") as device:
            listed = device.wait(lambda: device.get("/api/pictures")[1], "bad picture", 60)
            self.assertNotEqual(listed[0]["hidden"], [])
            self.assertIn("passed its self-test", device.request("GET", "/api/log")[2].decode())
            status, _, body = device.request("GET", "/api/diagnostics.tar")
            self.assertEqual(status, 200)
            with tarfile.open(fileobj=io.BytesIO(body)) as tar:
                names = tar.getnames()
                self.assertLessEqual({"diagnostics.json", "log.txt", "export.json"}, set(names))
                picture = next(name for name in names if name.endswith(".jpg"))
                self.assertEqual(tar.extractfile(picture).read()[:3], b"\xff\xd8\xff")
                self.assertEqual(json.load(tar.extractfile("diagnostics.json"))["finsight_diagnostics"], 1)


class Moving(unittest.TestCase):
    """Everything that was set up on one device, as one file, into another."""

    def device(self):
        device = Device(REST).__enter__()
        self.addCleanup(device.__exit__)
        return device

    def test_settings_lens_mount_and_zero_move_to_another_device_and_are_saved_there(self):
        first = self.device()
        self.assertEqual(first.order("zero", first.unlock()), "done")
        self.assertEqual(first.post("/api/settings", {"hold_time": 250}, first.unlock())[0], 200)
        file = first.get("/api/export")[1]
        self.assertLessEqual({"low", "middle", "top"}, set(file["zero"]))
        self.assertIn("[camera]", file["mount"])
        self.assertIn("fx_fy_cx_cy", file["lens"])
        second = self.device()
        self.assertEqual(second.get("/api/export")[1]["zero"], None)
        saved = Path(second.folder.name) / "state.toml"

        def refused(changes, words):
            status, answer = second.post("/api/import", file | changes, second.unlock())
            self.assertIn(status, (400, 409), answer)
            self.assertIn(words, answer["error"])
        refused({"pack_checksum": "sha256:0"}, "pack_checksum: found")
        refused({"settings": file["settings"] | {"hold_time": 1e6}}, "hold_time: found")
        refused({"zero": {"top": [1]}}, "zero.top")
        far = {plate: [9.9] * 6 for plate in ("low", "middle", "top")}
        refused({"zero": far}, "further from the finger's rest")
        for focal in ("1e-300", "0.001"):
            refused({"lens": re.sub(r"fx_fy_cx_cy = \[[^,]*", f"fx_fy_cx_cy = [{focal}", file["lens"])}, "fx")
        refused({"settings": {name: value for name, value in file["settings"].items() if name != "hold_time"}}, "it lacks hold_time")
        refused({"mount": file["mount"].replace("position_mm = [", "position_mm = [9", 1)}, "another finger")
        self.assertEqual(list((Path(second.folder.name) / "measured").glob("*")), [])
        self.assertEqual(second.post("/api/import", file, second.unlock())[0], 200)
        state = second.wait(lambda: (s := second.get("/api/state")[1]).get("hold_time") == 250 and s, "restart with what was imported")
        self.assertIn("zeroed", second.wait(lambda: "ready" in (s := second.get("/api/state")[1])["status"] and s, "measurement")["status"])
        self.assertNotIn("settings_unsaved", state["status"])
        self.assertIn("set = true", saved.read_text())
        self.assertFalse((Path(second.folder.name) / "measured" / "state.toml").exists())
        again = second.wait(lambda: (e := second.get("/api/export")[1]).get("zero") and e, "export")
        self.assertEqual({key: again[key] for key in ("settings", "zero", "lens", "mount")},
                         {key: file[key] for key in ("settings", "zero", "lens", "mount")})


class Mending(unittest.TestCase):
    """A device whose measuring program does not start because of a file that the page keeps."""

    def test_restore_and_import_work_without_the_measuring_program_and_it_starts_again(self):
        with Device(REST) as device:
            file = device.get("/api/export")[1]
            measured = Path(device.folder.name) / "measured"
            measured.mkdir(exist_ok=True)
            good, broken = file["lens"], re.sub(r"fx_fy_cx_cy = \[[^,]*", "fx_fy_cx_cy = [1e-300", file["lens"])

            def stop(lens):
                device.firmware.kill()
                device.firmware.wait(10)
                (measured / "lens.toml").write_text(lens)
                refused = subprocess.run([BINARIES / "finsightd", "--settings", device.settings, "--check"], capture_output=True, timeout=60)
                self.assertEqual(refused.returncode, 2)
                device.page.kill()  # it, too, must start
                device.page.wait(10)
                device.start_page()

            def mended(path, body):
                status, answer = device.post(path, body, device.unlock())
                self.assertEqual(status, 200, answer)
                self.assertIn("from its next start on", answer["note"])
                device.start_firmware()
                device.wait(lambda: "status" in device.get("/api/state")[1], "state after its restart")
            (measured / "lens.toml.former").write_text(good)
            stop(broken)
            mended("/api/lens/restore", {})
            self.assertEqual((measured / "lens.toml").read_text(), good)
            status, answer = device.post("/api/lens/restore", {}, device.unlock())
            self.assertEqual(status, 409)
            self.assertIn("cannot be used", answer["error"])
            stop(broken)
            mended("/api/import", file)
            self.assertEqual(device.wait(lambda: device.get("/api/export")[1].get("lens"), "export"), good)

    def test_a_restore_that_is_refused_changes_nothing(self):
        with Device(REST) as device:
            file = device.get("/api/export")[1]
            measured = Path(device.folder.name) / "measured"
            measured.mkdir(exist_ok=True)
            (measured / "mount.toml.former").write_text(file["mount"])
            (measured / "mount.toml").write_text("# another one\n" + file["mount"])
            before = {path.name: path.read_text() for path in measured.iterdir()}
            token = device.unlock()
            device.post("/api/command", {"command": "zero"}, token)  # takes a second
            status, answer = device.post("/api/mount/restore", {}, token)
            self.assertEqual(status, 409, answer)
            self.assertIn("exception 6", answer["error"])
            self.assertEqual({path.name: path.read_text() for path in measured.iterdir()}, before)


class Misuse(unittest.TestCase):
    def setUp(self):
        self.device = Device().__enter__()
        self.addCleanup(self.device.__exit__)

    def assert_works(self):
        self.assertEqual(self.device.request("GET", "/", timeout=30)[0], 200)

    def test_nothing_is_changed_without_the_key(self):
        for token in ("", "0" * 32, "x", "../../etc/passwd", "'\"--"):
            for path in ("/api/settings", "/api/command", "/api/recordings/delete", "/api/import", "/api/lens/capture",
                         "/api/mount/use", "/api/exclusive"):
                self.assertEqual(self.device.post(path, {"command": "factory"}, token)[0], 401, (path, token))
        status, answer = self.device.post("/api/unlock", {"key": 1})
        self.assertEqual(status, 403, answer)
        for wrong in (-1, 65536, "18003", None, 18003.5, [18003], 1e99):
            self.assertEqual(self.device.post("/api/unlock", {"key": wrong})[0], 400, wrong)
        for _ in range(4):
            status, answer = self.device.post("/api/unlock", {"key": 2})
        self.assertEqual(status, 429, answer)

    def test_pages_of_other_sites_can_neither_read_nor_write(self):
        own = f"127.0.0.1:{self.device.page_port}"
        for host in ("evil.com", f"evil.com:{self.device.page_port}", "", own + ".evil.com"):
            self.assertIn(self.device.request("GET", "/api/state", headers={"Host": host})[0], (400, 421), host)
        body = {"key": KEY}
        for origin in ("http://evil.com", "null", "http://127.0.0.1", "http://127.0.0.1:1"):
            self.assertEqual(self.device.post("/api/unlock", body, Origin=origin)[0], 403, origin)
        self.assertEqual(self.device.post("/api/unlock", body, **{"Sec-Fetch-Site": "cross-site"})[0], 403)
        for foreign in ({"Origin": "http://evil.com"}, {"Sec-Fetch-Site": "cross-site"}, {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "cors"}):
            for path in ("/api/state", "/frame.jpg", "/"):
                self.assertEqual(self.device.request("GET", path, headers=foreign)[0], 403, (path, foreign))
        link = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate"}
        self.assertEqual(self.device.request("GET", "/", headers=link)[0], 200)
        self.assertEqual(self.device.post("/api/unlock", body, **link)[0], 403)
        self.assertEqual(self.device.post("/api/unlock", body, **{"Content-Type": "text/plain"})[0], 415)
        self.assertEqual(self.device.post("/api/unlock", body, Origin=f"http://{own}")[0], 200)
        headers = self.device.request("GET", "/")[1]
        self.assertIn("default-src 'self'", headers["Content-Security-Policy"])
        self.assertNotIn("Access-Control-Allow-Origin", headers)
        self.assertEqual(self.device.request("OPTIONS", "/api/state")[0], 405)

    @unittest.skipIf(os.geteuid() != 0, "only root sees packets")
    def test_on_the_local_link_only_no_answer_passes_a_router(self):
        for more, expected in (("", 64), ("local_link_only = true", 1)):
            with Device(REST, more) as device, socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_TCP) as wire:
                wire.settimeout(10)
                self.assertEqual(device.request("GET", "/")[0], 200)
                lives = set()
                while len(lives) == 0:
                    packet = wire.recv(65536)
                    if int.from_bytes(packet[20:22], "big") == device.page_port:  # from the page
                        lives.add(packet[8])
                self.assertEqual(lives, {expected}, more)

    def test_paths_lead_nowhere_but_to_the_page(self):
        for path in ("/../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "/api/recordings/../state.toml", "/api/recordings/..%2fstate.tar",
                     "/api/recordings/session-0001/../../state.toml.tar", "/api/recordings/.tar", "//etc/passwd", "/index.html/..", "/app.js/",
                     "/api", "/%", "/%00", "/index.html%00", "/api/state%00x", "/" + "a" * 4000):
            self.assertIn(self.device.request("GET", path)[0], (400, 404), path)
        token = self.device.unlock()
        for name in ("..", "../measured", "session-0001/..", "", "session-9999", None, 7, "session-1\0"):
            self.assertEqual(self.device.post("/api/recordings/delete", {"name": name}, token)[0], 404, name)

    def test_a_body_of_a_gigabyte_is_refused_at_once(self):
        with self.device.raw() as connection:
            connection.sendall(f"POST /api/import HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: {1 << 30}\r\n\r\n{{".encode())
            self.assertIn(b" 413 ", connection.recv(4096))
        before = self.device.memory_kb()
        with self.device.raw() as connection:
            connection.sendall(b"POST /api/import HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\n")
            chunk = b"100000\r\n" + b"x" * 0x100000 + b"\r\n"
            sent = 0
            try:
                for _ in range(1024):
                    connection.sendall(chunk)
                    sent += 1
            except OSError:
                pass  # closed
        self.assertLess(sent, 64, "megabytes that were taken")
        self.assertLess(self.device.memory_kb(), before + 20_000)
        self.assert_works()

    def test_slow_and_silent_clients_are_closed_and_others_are_served(self):
        slow = [self.device.raw() for _ in range(12)]
        end = time.monotonic() + 40
        head = b"GET / HTTP/1.1\r\nHost: localhost\r\nX-Slow: "
        for connection in slow:
            connection.sendall(head)
        closed = set()
        while len(closed) < len(slow) and time.monotonic() < end:
            self.assert_works()
            for connection in slow:
                if connection in closed:
                    continue
                try:
                    connection.sendall(b"a")
                    connection.setblocking(False)
                    if connection.recv(100) == b"":
                        closed.add(connection)
                except BlockingIOError:
                    pass
                except OSError:
                    closed.add(connection)
                finally:
                    connection.setblocking(True)
            time.sleep(1)
        for connection in slow:
            connection.close()
        self.assertEqual(len(closed), len(slow))

    def test_two_hundred_connections_are_bounded_and_leave_room_for_another_address(self):
        before = self.device.memory_kb()
        many = []
        for _ in range(200):
            try:
                many.append(self.device.raw())
            except OSError:
                pass
        with socket.create_connection(("127.0.0.1", self.device.page_port), timeout=10, source_address=("127.0.0.2", 0)) as other:
            other.sendall(b"GET /api/registers HTTP/1.1\r\nHost: localhost\r\n\r\n")
            self.assertIn(b" 200 ", other.recv(4096))
        for connection in many:
            connection.close()
        self.device.wait(lambda: self.device.request("GET", "/")[0] == 200, "answer afterwards")
        self.assertLess(self.device.memory_kb(), before + 20_000)

    def test_garbage_is_answered_and_nothing_grows(self):
        rng = random.Random(1)
        words = [b"GET ", b"POST ", b"/api/state", b"/api/unlock", b" HTTP/1.1\r\n", b"Host: localhost\r\n", b"Content-Length: ", b"\r\n\r\n",
                 b"{\"key\":", b"}", b"\0", b"\xff" * 20, b"Transfer-Encoding: chunked\r\n", b"A" * 3000, b"[" * 2000, b"Content-Type: application/json\r\n"]

        def attack(_):
            try:
                with self.device.raw() as connection:
                    connection.settimeout(0.02)
                    connection.sendall(b"".join(rng.choices(words, k=rng.randrange(1, 14))))
                    connection.recv(4096)
            except OSError:
                pass
        for _ in range(300):
            attack(0)
        before = self.device.memory_kb()
        with ThreadPoolExecutor(8) as pool:
            list(pool.map(attack, range(3000)))
        self.device.wait(lambda: self.device.request("GET", "/")[0] == 200, "answer afterwards")
        self.assertLess(self.device.memory_kb(), before + 8_000)
        self.assertIsNone(self.device.page.poll())
        for body in ("", "{", "[" * 100_000, '{"key":' * 5000, "\xff", "null", "[]", '{"key":1e400}'):
            self.assertEqual(self.device.post("/api/unlock", body.encode("latin-1"))[0], 400, body[:20])

    def test_the_measuring_program_does_not_notice_that_the_page_is_killed_or_hangs(self):
        reader = Reader(self.device.port)
        self.device.wait(lambda: self.device.request("GET", "/frame.jpg")[0] == 200, "picture")
        for what in (signal.SIGSTOP, signal.SIGKILL):
            os.kill(self.device.page.pid, what)
            before = reader.read().words[2]
            self.device.wait(lambda: (reader.read().words[2] - before) % 65536 > 60, f"heartbeats after {what}")
            self.device.wait(lambda: reader.read().has("ready"), f"measurement after {what}")
        reader.close()
        self.device.page.wait(10)
        self.device.start_page()
        self.device.wait(lambda: self.device.get("/api/about")[0] == 200, "page after its restart")

    @unittest.skipIf(os.cpu_count() < 2, "the loop has no processor of its own here")
    def test_the_loop_is_as_quick_while_the_page_is_flooded_and_killed_as_without(self):
        # As on the image: the loop has a processor of its own, the page another, at low priority.
        with Device(REST, "[realtime]\ncpu = 1", ("taskset", "-c", "0", "nice", "-n", "10")) as device:
            reader = Reader(device.port)
            device.wait(lambda: reader.read().has("ready"), "measurement")
            stop, threads = threading.Event(), []

            def flood():
                os.sched_setaffinity(0, {0})  # and these would be other machines
                os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 19)
                while not stop.is_set():
                    try:
                        device.request("GET", "/frame.jpg", timeout=2)
                        device.post("/api/unlock", {"key": 7})
                    except (OSError, http.client.HTTPException, ValueError):
                        pass

            def median_latency():
                values, until = [], time.monotonic() + 1
                while time.monotonic() < until:
                    values.append(reader.read().at("latency"))
                    time.sleep(0.005)
                return statistics.median(values)
            alone, flooded = [], []
            for turn in range(6):
                alone.append(median_latency())
                stop.clear()
                threads = [threading.Thread(target=flood, daemon=True) for _ in range(6)]
                for thread in threads:
                    thread.start()
                if turn == 3:
                    device.page.kill()
                    device.page.wait(10)
                flooded.append(median_latency())
                stop.set()
                for thread in threads:
                    thread.join(10)
                if turn == 3:
                    device.start_page()
            self.assertLess(statistics.median(flooded), 2 * statistics.median(alone), (alone, flooded))
            reader.close()

    def test_the_page_says_so_when_the_measuring_program_is_gone_and_finds_it_again(self):
        self.device.firmware.send_signal(signal.SIGKILL)
        self.device.firmware.wait(10)
        self.assertIn("does not answer", self.device.wait(lambda: self.device.get("/api/state")[1].get("error"), "error"))
        for path in ("/api/state", "/metrics"):
            status, _, body = self.device.request("GET", path)
            self.assertEqual(status, 503, path)
            self.assertIn("does not answer", json.loads(body)["error"])
        self.assertEqual(self.device.post("/api/command", {"command": "zero"}, self.device.unlock())[0], 503)
        self.assert_works()
        self.device.start_firmware()
        self.device.wait(lambda: "status" in self.device.get("/api/state")[1], "state after its restart")


if __name__ == "__main__":
    prepare()
    render(REST, "--motion", "rest", "--seconds", "3")
    render(WORK / "covered", "--event", "covered", "--seconds", "30")
    unittest.main(verbosity=2)
