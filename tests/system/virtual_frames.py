"""Frames for libcamera's virtual camera: it shows the JPEGs of a folder, and takes nothing else."""
import shutil
import subprocess

SIZE = (640, 480)  # of the rendered sessions
YAML = """# SPDX-License-Identifier: CC0-1.0
%YAML 1.1
---
"Finger0":
  supported_formats:
  - width: 640
    height: 480
    frame_rates: [60, 60]
  frames:
    path: "{folder}/"
  location: "CameraLocationExternal"
  model: "virtual finger camera"
"""


def pgm(pixels):
    return b"P5\n%d %d\n255\n" % SIZE + bytes(pixels)


def write_frames(folder, images):
    """0.jpg, 1.jpg, ... of grey images. What the camera makes of them: its decoder (libyuv's) takes the fast inverse
    cosine transform, which changes half of the grey levels by one or two, and a tilt by tenths of a degree."""
    shown = []
    for number, pixels in enumerate(images):
        jpeg = subprocess.run(["cjpeg", "-quality", "100", "-grayscale"], input=pgm(pixels), stdout=subprocess.PIPE,
                              check=True).stdout
        (folder / f"{number}.jpg").write_bytes(jpeg)
        decoded = subprocess.run(["djpeg", "-dct", "fast", "-grayscale", "-pnm"], input=jpeg, stdout=subprocess.PIPE,
                                 check=True).stdout
        shown.append(decoded[-len(pixels):])
    return shown


def write_session(folder, like, images):
    """A session of these images, otherwise like the session `like`."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    header = (like / "frames.y4m").read_bytes().split(b"\n", 1)[0] + b"\n"
    (folder / "frames.y4m").write_bytes(header + b"".join(b"FRAME\n" + bytes(pixels) for pixels in images))
    shutil.copy(like / "session.toml", folder)
