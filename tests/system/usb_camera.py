#!/usr/bin/python3
"""A USB camera for an emulated machine: shows a session's grey images in a loop, can be plugged in and pulled out.

Stays plugged in until Ctrl-C or until the machine is switched off. Exit codes: 0 done, 1 no machine, 2 wrong arguments

To the guest this is a camera like any other; its own drivers talk to it. Two protocols are spoken here:

usbredir carries a USB device over a socket: packets of type, length and id, of which the emulated machine is the one
end and the program that has the device is the other. Connecting plugs the device in, closing pulls it out. Implemented
is what a device with one bulk endpoint needs: the greeting; what the device is (device_connect, interface_info,
ep_info); the choice of configuration and setting, of which there is one each; control and bulk transfers; cancelling
and reset. The other end must know 64-bit ids and 32-bit lengths, as every QEMU since 2.0 does.

USB video class 1.0: a camera terminal, an output terminal, and one stream of 8-bit grey (Y800) in one size at one rate
over a bulk endpoint. Whatever the guest proposes, it gets this mode; its "commit" starts a stream, its transfers take
the images. Each transfer carries one payload: two bytes of header (which of two alternating images, and whether
this is its end), then pixels. A guest that takes its transfers late gets the same images later and misses none, so
that the guest's own frame counter says which image it sees.
"""
import argparse
import collections
import select
import socket
import struct
import sys
import threading
import time
from pathlib import Path

# usbredir: packet types, status codes, and what we expect of the other end besides the basics.
HELLO, DEVICE_CONNECT, RESET, INTERFACE_INFO, EP_INFO = 0, 1, 3, 4, 5
SET_CONFIGURATION, GET_CONFIGURATION, CONFIGURATION_STATUS = 6, 7, 8
SET_ALT_SETTING, GET_ALT_SETTING, ALT_SETTING_STATUS = 9, 10, 11
CANCEL_DATA_PACKET, CONTROL_PACKET, BULK_PACKET = 21, 100, 101
SUCCESS, CANCELLED, STALL = 0, 1, 4
DEVICE_VERSION, MAX_PACKET_SIZES, IDS_64_BIT, LENGTHS_32_BIT = 1 << 1, 1 << 4, 1 << 5, 1 << 6
CAPABILITIES = DEVICE_VERSION | MAX_PACKET_SIZES | IDS_64_BIT | LENGTHS_32_BIT
HIGH_SPEED = 2
ENDPOINTS = 32  # in its tables: 16 out, then 16 in

# USB and its video class.
VENDOR, PRODUCT, RELEASE = 0x1D6B, 0x0102, 0x0100  # Linux Foundation, webcam gadget
STREAM_ENDPOINT, STREAM_PACKET = 0x81, 512
CONTROL_INTERFACE, STREAM_INTERFACE = 0, 1
VIDEO, VIDEO_CONTROL, VIDEO_STREAMING = 14, 1, 2
CLASS_DESCRIPTOR = 0x24
GREY = b"Y800" + bytes.fromhex("00001000800000aa00389b71")
PROBE, COMMIT = 1, 2
SET_CURRENT, GET_MODE = 0x01, (0x81, 0x82, 0x83, 0x84, 0x87)  # current, least, greatest, step, default
PAYLOAD = 16384
END_OF_HEADER, END_OF_PICTURE = 0x80, 0x02


def read_images(session):
    """Width, height and the grey images of a session."""
    data = memoryview((Path(session) / "frames.y4m").read_bytes())
    header = bytes(data[:1024]).split(b"\n", 1)[0]
    fields = {word[:1]: word[1:] for word in header.split()[1:]}
    width, height = int(fields[b"W"]), int(fields[b"H"])
    assert fields[b"C"] == b"mono", f"{session}: grey images (Cmono) are expected"
    images, mark = [], b"FRAME\n"
    at = len(header) + 1
    while at < len(data):
        assert data[at:at + len(mark)] == mark, f"{session}: no frame at byte {at}"
        at += len(mark)
        images.append(data[at:at + width * height])
        at += width * height
    return width, height, images


def descriptor(layout, *fields):
    """Every descriptor begins with its own length."""
    body = struct.pack("<" + layout, *fields)
    return bytes([len(body) + 1]) + body


def device_descriptor():
    association = (0xEF, 2, 1)  # "look at the interfaces"
    return descriptor("BHBBBBHHHBBBB", 1, 0x0200, *association, 64, VENDOR, PRODUCT, RELEASE, 0, 1, 0, 1)


def configuration_descriptor(width, height, fps):
    interface = lambda number, endpoints, subclass: descriptor("8B", 4, number, 0, endpoints, VIDEO, subclass, 0, 0)
    camera = descriptor("BBBHBBHHHB3x", CLASS_DESCRIPTOR, 2, 1, 0x0201, 0, 0, 0, 0, 0, 3)
    output = descriptor("BBBHBBB", CLASS_DESCRIPTOR, 3, 2, 0x0101, 0, 1, 0)
    control = descriptor("BBHHIBB", CLASS_DESCRIPTOR, 1, 0x0100, 13 + len(camera + output), 48_000_000, 1,
                         STREAM_INTERFACE)
    size, interval = width * height, round(1e7 / fps)
    bits_per_second = round(8 * size * fps)
    pixels = descriptor("BBBB16s6B", CLASS_DESCRIPTOR, 4, 1, 1, GREY, 8, 1, 0, 0, 0, 0)
    frame = descriptor("BBBBHHIIIIBI", CLASS_DESCRIPTOR, 5, 1, 0, width, height, bits_per_second, bits_per_second, size,
                       interval, 1, interval)
    stream = descriptor("BBBH8B", CLASS_DESCRIPTOR, 1, 1, 14 + len(pixels + frame), STREAM_ENDPOINT, 0, 2, 0, 0, 0, 1,
                        0)
    endpoint = descriptor("BBBHB", 5, STREAM_ENDPOINT, 2, STREAM_PACKET, 0)
    parts = (descriptor("7B", 11, CONTROL_INTERFACE, 2, VIDEO, 3, 0, 0) +
             interface(CONTROL_INTERFACE, 0, VIDEO_CONTROL) + control + camera + output +
             interface(STREAM_INTERFACE, 1, VIDEO_STREAMING) + stream + pixels + frame + endpoint)
    return descriptor("BHBBBBB", 2, 9 + len(parts), 2, 1, 0, 0x80, 50) + parts


def mode(width, height, fps):
    """The answer to every question about streaming parameters: the only mode there is."""
    return struct.pack("<HBBIHHHHHII", 1, 1, 1, round(1e7 / fps), 0, 0, 0, 0, 0, width * height, PAYLOAD)


class UsbCamera:
    """One camera; plug() and unplug() may be called again and again. A thread serves the machine meanwhile."""

    def __init__(self, socket_path, session, fps):
        self.path, self.fps = str(socket_path), fps
        width, height, self.images = read_images(session)
        self.mode = mode(width, height, fps)
        self.descriptors = {(1, 0): device_descriptor(), (2, 0): configuration_descriptor(width, height, fps),
                            (3, 0): descriptor("BH", 3, 0x0409),
                            (3, 1): descriptor("B20s", 3, "USB camera".encode("utf-16le"))}
        self.thread = None

    def plug(self, patience_s=5):
        """Raises OSError if there is no machine; one that has just been switched on may take a moment."""
        end = time.monotonic() + patience_s
        while True:
            self.link = socket.socket(socket.AF_UNIX)
            try:
                self.link.connect(self.path)
                break
            except OSError:
                self.link.close()
                if time.monotonic() > end:
                    raise
                time.sleep(0.05)
        self.waiting = collections.deque()  # the guest's transfers: id and length
        self.start_stream()
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.thread.start()

    def unplug(self):
        if self.thread:
            try:
                self.link.shutdown(socket.SHUT_RDWR)
            except OSError:  # the machine is off
                pass
            self.thread.join()
            self.link.close()
            self.thread = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.unplug()

    def serve(self):
        try:
            self.greet()
            received = b""
            while True:
                if select.select([self.link], [], [], self.pause_s())[0]:
                    part = self.link.recv(1 << 18)
                    if not part:
                        return
                    received = self.answer_all(received + part)
                self.send_images()
        except ConnectionError:  # switched off, or unplugged
            return

    def send(self, kind, body, packet_id=0):
        self.link.sendall(struct.pack("<IIQ", kind, len(body), packet_id) + body)

    def greet(self):
        """The greetings are the only packets with 32-bit ids: neither end knows yet what the other one can."""
        hello = struct.pack("<64sI", b"finsight usb_camera", CAPABILITIES)
        self.link.sendall(struct.pack("<III", HELLO, len(hello), 0) + hello)
        kind, length, _ = struct.unpack("<III", self.link.recv(12, socket.MSG_WAITALL))
        theirs = self.link.recv(length, socket.MSG_WAITALL)
        assert kind == HELLO and struct.unpack_from("<I", theirs, 64)[0] & CAPABILITIES == CAPABILITIES, theirs
        self.describe()
        self.send(DEVICE_CONNECT, struct.pack("<BBBBHHH", HIGH_SPEED, 0xEF, 2, 1, VENDOR, PRODUCT, RELEASE))

    def describe(self):
        """Interfaces and endpoints in usbredir's tables."""
        self.send(INTERFACE_INFO, struct.pack("<I32s32s32s32s", 2, bytes([CONTROL_INTERFACE, STREAM_INTERFACE]),
                                              bytes([VIDEO, VIDEO]), bytes([VIDEO_CONTROL, VIDEO_STREAMING]), b""))
        control, bulk, none, stream = 0, 2, 255, 16 + (STREAM_ENDPOINT & 15)
        kinds, interfaces, sizes = [none] * ENDPOINTS, [0] * ENDPOINTS, [0] * ENDPOINTS
        kinds[0] = kinds[16] = control
        sizes[0] = sizes[16] = 64
        kinds[stream], interfaces[stream], sizes[stream] = bulk, STREAM_INTERFACE, STREAM_PACKET
        self.send(EP_INFO, bytes(kinds) + bytes(ENDPOINTS) + bytes(interfaces) + struct.pack("<32H", *sizes))

    def answer_all(self, received):
        """Answers every packet that is complete; what is left over."""
        while len(received) >= 16:
            kind, length, packet_id = struct.unpack_from("<IIQ", received)
            if len(received) < 16 + length:
                break
            self.answer(kind, packet_id, received[16:16 + length])
            received = received[16 + length:]
        return received

    def answer(self, kind, packet_id, body):
        if kind == CONTROL_PACKET:
            self.answer_control(packet_id, body)
        elif kind == BULK_PACKET:
            _, _, low, _, high = struct.unpack("<BBHIH", body[:10])
            self.waiting.append((packet_id, high << 16 | low))
        elif kind == CANCEL_DATA_PACKET:
            for transfer in [t for t in self.waiting if t[0] == packet_id]:
                self.waiting.remove(transfer)
                self.finish_transfer(packet_id, b"", CANCELLED)
        elif kind == RESET:
            self.waiting.clear()
        elif kind in (SET_CONFIGURATION, GET_CONFIGURATION):
            self.describe()
            self.send(CONFIGURATION_STATUS, bytes([SUCCESS, 1]), packet_id)
        elif kind in (SET_ALT_SETTING, GET_ALT_SETTING):
            self.send(ALT_SETTING_STATUS, bytes([SUCCESS, body[0], 0]), packet_id)
        # Everything else is about what this device does not have, or wants no answer.

    def answer_control(self, packet_id, body):
        endpoint, request, kind, _, value, index, length = struct.unpack("<BBBBHHH", body[:10])
        result = self.control(kind, request, value, index)
        status = STALL if result is None else SUCCESS
        data = (result or b"")[:length] if kind & 0x80 else b""
        done = len(data) if kind & 0x80 else length
        self.send(CONTROL_PACKET, struct.pack("<BBBBHHH", endpoint, request, kind, status, value, index, done) + data,
                  packet_id)

    def control(self, kind, request, value, index):
        """The bytes that the guest asks for, none for what it tells; None: not known to this device."""
        if kind == 0x80 and request == 6:
            return self.descriptors.get((value >> 8, value & 255))
        if kind == 0x80 and request == 0:  # status: powered by the bus
            return b"\0\0"
        if kind == 0x02 and request == 1:  # clear halt: how Linux says that it wants no more images
            return b""
        if kind & 0x7F == 0x21 and index & 255 == STREAM_INTERFACE and value >> 8 in (PROBE, COMMIT):
            if request == SET_CURRENT:
                if value >> 8 == COMMIT:
                    self.start_stream()
                return b""
            return self.mode if request in GET_MODE else None
        return None

    def start_stream(self):
        self.shown, self.sent, self.due = 0, 0, time.monotonic()

    def pause_s(self):
        """How long there is nothing to send: for ever when nobody waits for pixels."""
        return max(0.0, self.due - time.monotonic()) if self.waiting else None

    def send_images(self):
        """As many payloads as there are transfers for; between two images none before the next is due."""
        while self.waiting and (self.sent or time.monotonic() >= self.due):
            packet_id, room = self.waiting.popleft()
            image = self.images[self.shown % len(self.images)]
            part = image[self.sent:self.sent + min(room, PAYLOAD) - 2]
            self.sent += len(part)
            last = self.sent == len(image)
            bits = END_OF_HEADER | (self.shown & 1) | (END_OF_PICTURE if last else 0)
            self.finish_transfer(packet_id, bytes([2, bits]) + part)
            if last:
                self.shown, self.sent = self.shown + 1, 0
                self.due = max(self.due + 1 / self.fps, time.monotonic())

    def finish_transfer(self, packet_id, data, status=SUCCESS):
        header = struct.pack("<BBHIH", STREAM_ENDPOINT, status, len(data) & 0xFFFF, 0, len(data) >> 16)
        self.send(BULK_PACKET, header + data, packet_id)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("socket", metavar="SOCKET",
                        help="of a QEMU with: -device qemu-xhci -chardev socket,id=camera,path=SOCKET,server=on,wait=off "
                        "-device usb-redir,chardev=camera")
    parser.add_argument("session", metavar="SESSION", help="folder with frames.y4m (Cmono)")
    parser.add_argument("--fps", type=float, default=20, metavar="N", help="images per second (default 20)")
    arguments = parser.parse_args()
    with UsbCamera(arguments.socket, arguments.session, arguments.fps) as camera:
        try:
            camera.plug()
        except OSError as error:
            print(f"usb_camera: {arguments.socket}: {error.strerror}", file=sys.stderr)
            return 1
        camera.thread.join()
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(0)
