"""Frames for libcamera's virtual camera: it shows the JPEGs of a folder, and takes nothing else."""
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


def write_frames(folder, pictures):
    """0.jpg, 1.jpg, ... of grey pictures."""
    for number, pixels in enumerate(pictures):
        jpeg = subprocess.run(["cjpeg", "-quality", "100", "-grayscale"], input=pgm(pixels), stdout=subprocess.PIPE,
                              check=True)
        (folder / f"{number}.jpg").write_bytes(jpeg.stdout)
