"""Dumps as TBMMapMerging writes them: 48 bytes a cell in an LZ4 frame of roslz4."""

import struct

import lz4.frame
import numpy as np

from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN


def write_merging_dump(path, grid):
    g, masses = grid.geometry, grid.masses.reshape(-1, 4).astype("<f8")
    cells = np.ones((len(masses), 6), "<f8")
    cells[:, 0] = masses[:, OCCUPIED] + 0.5 * masses[:, UNKNOWN]
    cells[:, 2:] = masses[:, [UNKNOWN, FREE, OCCUPIED, CONFLICT]]
    origin = [round(-corner / g.resolution) for corner in (g.origin_x, g.origin_y)]
    frame = lz4.frame.compress(
        cells.tobytes(), block_size=lz4.frame.BLOCKSIZE_MAX4MB, block_linked=False, content_checksum=True,
        store_size=False,
    )  # fmt: skip
    path.write_bytes(struct.pack("<iidii", g.rows, g.cols, g.resolution, *origin) + frame)
