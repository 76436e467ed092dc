"""OpenCV's calibrateCamera on photographs of a board, for `cargo xtask bench`.

    opencv_calibration.py COLUMNS ROWS PITCH_MM IMAGE...

findChessboardCorners, cornerSubPix (+-5 px), calibrateCamera with k1 k2 p1 p2 k3 (its
default), one thread. Prints one line per figure: name, tab, value.
"""

import sys
import time

import cv2
import numpy as np

STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 1e-3)


def main():
    cv2.setNumThreads(1)
    columns, rows, pitch_mm = int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    board = np.zeros((columns * rows, 3), np.float32)
    board[:, :2] = np.mgrid[0:columns, 0:rows].T.reshape(-1, 2) * pitch_mm
    start = time.perf_counter()
    boards, seen = [], []
    for path in sys.argv[4:]:
        image = cv2.imread(path, cv2.IMREAD_GRAYSCALE)
        found, corners = cv2.findChessboardCorners(image, (columns, rows))
        if found:
            seen.append(cv2.cornerSubPix(image, corners, (5, 5), (-1, -1), STOP))
            boards.append(board)
    result = cv2.calibrateCameraExtended(boards, seen, image.shape[::-1], None, None)
    rms_px, matrix, deviations = result[0], result[1], result[5]
    print(f"seconds\t{time.perf_counter() - start:.2f}")
    print(f"photographs\t{len(boards)}")
    print(f"rms_px\t{rms_px:.4f}")
    print(f"fx_px\t{matrix[0, 0]:.2f}")
    print(f"fx_sd_px\t{deviations[0, 0]:.2f}")


if __name__ == "__main__":
    main()
