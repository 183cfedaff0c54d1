#!/usr/bin/env python3
"""usage: bowed.py > bowed.obj

The surface of bowed.toml's finger, in mm, as a CAD program would export it: a touched face that is bowed over its height
and crowned across, and a straight back, joined by the tip and by three struts that carry the plates. Cells of a bent grid
are filled or not; every face between a filled and an empty one is two triangles, so the surface closes by itself.
"""
import math

HEIGHT = 100
ACROSS = [-1, -0.36, 0.36, 1]  # of the half width
DEEP = [0.15, 0.85]            # of the inner depth; before and behind them the walls' inner faces
LEVELS = [0, 16, 32, 38, 55, 61, 76, 82, 90, HEIGHT]
WALL = 3.5
PLATE = 2
STRUTS = {32: 0, 55: 2, 76: 1}  # a strut's lower side, and the column of cells in which it runs from front to back
COLUMNS, ROWS, LAYERS = len(ACROSS) - 1, len(LEVELS) - 1, len(DEEP) + 3
PLATE_LAYER = 2                 # the layer of cells under which a strut carries its plate


def half_width(y):
    return 25 - 0.09 * y


def front(x, y):
    return -26 + 0.24 * y - 3 * math.sin(math.pi * y / HEIGHT) + 0.003 * x * x


def back(y):
    return 22 - 0.12 * y


def point(i, y, k):
    x = ACROSS[i] * half_width(y)
    inner, depth = front(x, y) + WALL, back(y) - front(x, y) - 2 * WALL
    z = [front(x, y), inner, *(inner + share * depth for share in DEEP), inner + depth, back(y)][k]
    return x, y, z


def filled(i, j, k):
    """The cell between grid lines i, j, k and the next ones."""
    if not (0 <= i < COLUMNS and 0 <= j < ROWS and 0 <= k < LAYERS):
        return False
    return k in (0, LAYERS - 1) or j == ROWS - 1 or STRUTS.get(LEVELS[j]) == i


def face(cell, axis, side, height):
    """The four corners of a cell's face, counter-clockwise seen from outside; height(j) is that of grid line j."""
    quad = []
    for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)):
        corner = list(cell)
        corner[axis] += side
        corner[(axis + 1) % 3] += u
        corner[(axis + 2) % 3] += v
        quad.append((corner[0], height(corner[1]), corner[2]))
    return quad if side else quad[::-1]


def all_faces():
    for cell in ((i, j, k) for i in range(COLUMNS) for j in range(ROWS) for k in range(LAYERS) if filled(i, j, k)):
        carries_plate = STRUTS.get(LEVELS[cell[1]]) == cell[0] and cell[2] == PLATE_LAYER
        for axis in range(3):
            for side in (0, 1):
                beside = list(cell)
                beside[axis] += 2 * side - 1
                if not filled(*beside) and not (carries_plate and (axis, side) == (1, 0)):
                    yield face(cell, axis, side, lambda j: LEVELS[j])
        if carries_plate:
            top = LEVELS[cell[1]]
            for axis, side in ((0, 0), (0, 1), (1, 0), (2, 0), (2, 1)):
                yield face(cell, axis, side, lambda j: top if j > cell[1] else top - PLATE)


def main():
    numbers, triangles = {}, []
    for quad in all_faces():
        a, b, c, d = (numbers.setdefault(corner, len(numbers) + 1) for corner in quad)
        triangles += [(a, b, c), (a, c, d)]
    print("# made by bowed.py")
    for corner in numbers:
        print("v %.4f %.4f %.4f" % point(*corner))
    for triangle in triangles:
        print("f %d %d %d" % triangle)


main()
