"""Photographs of checkerboards as people hold them, and what OpenCV finds in them, for
`cargo xtask bench --boards-only`.

    boards.py DIRECTORY COUNT SEED

Renders COUNT photographs into DIRECTORY (0000.pgm and so on): squares of 8 to 250 px, a third of
the boards cut by the frame's border with all their inner corners inside, defocus up to 3 px,
uneven light, JPEG, and every tenth photograph without any board but with other objects. Each line
of DIRECTORY/list.txt is `file COLUMNS ROWS kind`, followed by the true x and y of each inner corner
in row order (none without a board); DIRECTORY/opencv.txt has, for each photograph, whether
findChessboardCorners and findChessboardCornersSB found the board, as 1 or 0. Every photograph is a
function of the seed and its number alone.
"""

import os
import sys

import cv2
import numpy as np

FRAMES = [(640, 480), (1280, 720), (1456, 1088), (720, 1280), (1080, 1440), (1536, 2048)]
# An OpenCV corner counts as right within this share of a square.
RIGHT = 0.3


def background(random, width, height):
    """Walls, furniture, fine texture, tiles, bars, text."""
    scene = np.full((height, width), random.uniform(60, 190), np.uint8)
    for _ in range(random.integers(10, 40)):
        x, y = random.uniform(0, width), random.uniform(0, height)
        w, h = random.uniform(10, 0.5 * width), random.uniform(10, 0.5 * height)
        box = cv2.boxPoints(((x, y), (w, h), random.uniform(0, 90)))
        cv2.fillConvexPoly(scene, box.astype(np.int32), random.uniform(20, 235))
    for _ in range(random.integers(0, 4)):
        text = "".join(chr(random.integers(33, 127)) for _ in range(20))
        at = (int(random.uniform(0, width)), int(random.uniform(0, height)))
        size = random.uniform(0.5, 3)
        cv2.putText(scene, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, random.uniform(0, 255), 2)
    scene = scene.astype(np.float32)
    kind = random.integers(0, 4)
    if kind == 0:  # tiles with joints
        pitch = int(random.uniform(15, 80))
        scene[::pitch, :] = 60
        scene[:, ::pitch] = 60
    elif kind == 1:  # bricks
        pitch = int(random.uniform(15, 60))
        for row, y in enumerate(range(0, height, pitch)):
            scene[y : y + 2, :] = 220
            scene[y : y + pitch, (row % 2) * pitch :: 2 * pitch] = 220
    elif kind == 2:  # stripes
        period = random.uniform(8, 60)
        stripes = (np.arange(width) / period).astype(int) % 2
        part = slice(int(height * random.uniform(0, 0.7)), height)
        scene[part] = 80 + 90 * stripes
    texture = random.normal(0, random.uniform(0, 12), scene.shape).astype(np.float32)
    return scene + cv2.GaussianBlur(texture, (0, 0), random.uniform(0.5, 2))


def corners_of(columns, rows):
    return np.mgrid[0:columns, 0:rows].T.reshape(-1, 2).astype(np.float64)


def rotation(yaw, pitch, roll):
    axes = [np.array([[0, yaw, 0]]), np.array([[pitch, 0, 0]]), np.array([[0, 0, roll]])]
    turn = np.eye(3)
    for axis in axes:
        turn = turn @ cv2.Rodrigues(axis)[0]
    return turn


def project(points, turn, place, focal, centre, k1):
    seen = points @ turn.T + place
    flat = seen[:, :2] / seen[:, 2:]
    bent = flat * (1 + k1 * np.sum(flat**2, axis=1, keepdims=True))
    return bent * focal + centre


def pose(random, columns, rows, width, height, cut):
    """A pose at which all inner corners are inside; the squares around them are inside too, or, for
    a cut board, not all of them. Returns the projection of points in squares, and the corners."""
    inner = np.c_[corners_of(columns, rows), np.zeros(columns * rows)]
    outer = np.array([[x, y, 0] for x in (-1.6, columns + 0.6) for y in (-1.6, rows + 0.6)])
    squares = np.array([[x, y, 0] for x in (-1, columns) for y in (-1, rows)])
    middle = np.array([(columns - 1) / 2, (rows - 1) / 2, 0])
    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    largest = 1.15 * max(width, height) / min(columns, rows)
    for _ in range(20000):
        square = np.exp(random.uniform(np.log(8), np.log(min(250, largest))))
        focal = random.uniform(0.7, 1.3) * max(width, height)
        k1 = random.uniform(-0.15, 0.05)
        roll = random.uniform(-0.5, 0.5) + random.choice([0, np.pi / 2])
        turn = rotation(random.uniform(-0.7, 0.7), random.uniform(-0.7, 0.7), roll)
        depth = focal / square
        place = np.array([*random.uniform(-0.5, 0.5, 2) * [width, height] / focal * depth, depth])
        view = lambda points: project(points - middle, turn, place, focal, centre, k1)
        if np.min(((outer - middle) @ turn.T + place)[:, 2]) < 0.2 * depth:
            continue
        seen = view(inner)
        inside = lambda px, edge: np.all((px >= edge) & (px <= [width - 1 - edge, height - 1 - edge]))
        grid = seen.reshape(rows, columns, 2)
        steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)]
        if not inside(seen, 7) or min(steps) < 6 or max(steps) > 260:
            continue
        if inside(view(squares), 0) == cut or (not cut and not inside(view(outer), 0)):
            continue
        return view, seen, min(steps)
    return None


def photograph(seed, number):
    random = np.random.default_rng([seed, number])
    width, height = FRAMES[random.integers(len(FRAMES))]
    columns, rows = random.integers(4, 12), random.integers(3, 9)
    scene = background(random, width, height)
    cut = bool(random.random() < 0.33)
    placed = None if number % 10 == 9 else pose(random, columns, rows, width, height, cut)
    kind, seen, step = "none", None, 20.0
    if placed is not None:
        view, seen, step = placed
        kind = "cut" if cut else "whole"
        fine = 3 if max(width, height) < 1600 else 2
        canvas = cv2.resize(scene, None, fx=fine, fy=fine, interpolation=cv2.INTER_LINEAR)

        def polygon(corners, level):
            # Along the sides as well: a lens bends them.
            line = np.linspace(corners, np.roll(corners, -1, axis=0), 8, axis=1)[:, :-1]
            line = line.reshape(-1, 2)
            px = (view(np.c_[line, np.zeros(len(line))]) + 0.5) * fine - 0.5
            px = np.clip(px, -30000, 30000)
            cv2.fillPoly(canvas, [np.round(px * 16).astype(np.int32)], level, cv2.LINE_8, 4)

        def square(x, y, width, height):
            return np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])

        margin = random.uniform(0.3, 1.0) if cut else 0.6
        white, black = random.uniform(150, 250), random.uniform(5, 70)
        sides = [columns + 1 + 2 * margin, rows + 1 + 2 * margin]
        polygon(square(-1 - margin, -1 - margin, *sides), white)
        for y in range(-1, rows):
            for x in range(-1, columns):
                if (x + y) % 2 == 0:
                    polygon(square(x, y, 1, 1), black)
        scene = cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA)
    # Defocus of up to 3 px; squares that it would wash out are not asked for.
    blur = random.uniform(0.4, min(3.0, max(0.6, step / 6)))
    scene = cv2.GaussianBlur(scene, (0, 0), blur)
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    slope = random.uniform(-0.5, 0.5, 2)
    light = 1 + slope[0] * (x / width - 0.5) + slope[1] * (y / height - 0.5)
    light *= 1 - random.uniform(0, 0.5) * ((x / width - 0.5) ** 2 + (y / height - 0.5) ** 2)
    if random.random() < 0.3:  # the edge of a shadow
        across = random.normal(0, 1, 2)
        side = (x / width - 0.5) * across[0] + (y / height - 0.5) * across[1]
        light *= 1 - 0.4 / (1 + np.exp(-side * random.uniform(10, 80)))
    scene = scene * light * random.uniform(0.5, 1.1)
    scene += random.normal(0, random.uniform(0.5, 4), scene.shape)
    image = np.clip(np.round(scene), 0, 255).astype(np.uint8)
    quality = int(random.integers(40, 96))
    _, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE), int(columns), int(rows), kind, seen


def is_right(found, corners, seen, columns, rows):
    if not found:
        return False
    corners = corners.reshape(-1, 2)
    step = np.linalg.norm(np.diff(seen.reshape(rows, columns, 2), axis=1), axis=2).min()
    distances = np.linalg.norm(corners[:, None] - seen[None], axis=2)
    return bool(np.all(distances.min(axis=1) < RIGHT * step))


def main():
    cv2.setNumThreads(1)
    directory, count, seed = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    os.makedirs(directory, exist_ok=True)
    with open(f"{directory}/list.txt", "w") as entries, open(f"{directory}/opencv.txt", "w") as out:
        for number in range(count):
            image, columns, rows, kind, seen = photograph(seed, number)
            name = f"{number:04}.pgm"
            cv2.imwrite(f"{directory}/{name}", image)
            truth = [] if seen is None else [f"{value:.3f}" for value in seen.ravel()]
            print(name, columns, rows, kind, *truth, file=entries)
            found = []
            for find in (cv2.findChessboardCorners, cv2.findChessboardCornersSB):
                result = find(image, (columns, rows))
                found.append(int(seen is not None and is_right(*result, seen, columns, rows)))
            print(name, *found, file=out, flush=True)
    print(f"version\t{cv2.__version__}")


if __name__ == "__main__":
    main()
