"""Pictures of maps for map_server: brightness, alpha channel, and the occupancy of pixels."""

import os
import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from tbmslam.map.map_check import MapFileError, check_size
from tbmslam.special_file import why_unreadable

# Magic, width, height and maximum, with comments between them; a single space ends the header.
_SEPARATOR = rb"(?:\s|#[^\n]*\n)+"
_PGM_HEADER = re.compile(rb"P([25])" + _SEPARATOR + _SEPARATOR.join([rb"(\d{1,9})"] * 3) + rb"(?:#[^\n]*\n|\s)")
_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_HEAD_BYTES, _MOST_BYTES = 1 << 16, 1 << 30


@dataclass(frozen=True)
class MapImage:
    """A decoded picture."""

    pixels: npt.NDArray[Any]
    """Unsigned integers (rows, cols, channels), the top row first: grey, or three colours, then perhaps alpha."""
    maximum: int
    """Value of full brightness."""

    @property
    def alpha(self) -> npt.NDArray[Any] | None:
        """The alpha channel (rows, cols); None if the picture has none."""
        return self.pixels[..., -1] if self.pixels.shape[-1] in {2, 4} else None

    def channel_sum(self, with_alpha: bool) -> tuple[npt.NDArray[np.uint32], int]:
        """Return the sum of the channels (rows, cols), and its value at full brightness."""
        channels = self.pixels.shape[-1]
        if self.alpha is not None and not with_alpha:
            channels -= 1
        return self.pixels[..., :channels].sum(axis=-1, dtype=np.uint32), channels * self.maximum


def read_image(path: Path) -> MapImage:
    """Read a picture: PGM of any depth, or what OpenCV reads (PNG, BMP, TIFF and more).

    Raises a `MapFileError` if the file is missing, damaged, too large, or not a picture of 8 or 16 bits.
    """
    if why := "is no file but a folder" if path.is_dir() else why_unreadable(path):
        raise MapFileError(f"{path}: the map's image {why}: name a picture")
    try:
        with path.open("rb") as file:
            content = file.read(_HEAD_BYTES)
            _check_stated_size(path, content)  # before a sparse file takes all memory
            if os.fstat(file.fileno()).st_size > _MOST_BYTES:
                raise MapFileError(f"{path}: the map's image is larger than 1 GB: crop it or save it as PNG")
            content += file.read()
    except OSError as error:
        raise MapFileError(f"{path}: the map's image cannot be read: {error.strerror}") from error
    return _decode_pgm(path, content) if content[:2] in {b"P2", b"P5"} else _decode(path, content)


def encode_pgm(pixels: npt.NDArray[np.uint8]) -> bytes:
    """Return a grey picture (rows, cols), top row first, as a binary PGM file."""
    rows, cols = pixels.shape
    return f"P5\n{cols} {rows}\n255\n".encode() + pixels.tobytes()


def _check_stated_size(path: Path, head: bytes) -> None:
    """Check the size that a picture's header states, if any."""
    header = _PGM_HEADER.match(head)
    if header is not None:
        check_size(path, rows=int(header[3]), cols=int(header[2]))
    elif head.startswith(_PNG_SIGNATURE) and len(head) >= 24:
        check_size(path, rows=int.from_bytes(head[20:24], "big"), cols=int.from_bytes(head[16:20], "big"))


def _decode_pgm(path: Path, content: bytes) -> MapImage:
    """Decode a PGM: OpenCV does not return its maximum, which need not be 255."""
    header = _PGM_HEADER.match(content)
    if header is None:
        raise MapFileError(f"{path}: has no PGM header with width, height and maximum: it is damaged")
    kind, cols, rows, maximum = (int(group) for group in header.groups())
    if not 1 <= maximum <= 65535:
        raise MapFileError(f"{path}: the PGM's maximum must be 1 to 65535, got {maximum}: make it again")
    body, count = memoryview(content)[header.end() :], rows * cols
    values: npt.NDArray[Any]
    if kind == 5:
        dtype = np.dtype(np.uint8 if maximum < 256 else ">u2")
        values = np.frombuffer(body, dtype=dtype, count=min(count, len(body) // dtype.itemsize))
    else:
        try:
            values = np.array(re.sub(rb"#[^\n]*", b"", body).split()[:count], dtype=np.uint32)
        except (ValueError, OverflowError):
            raise MapFileError(f"{path}: the PGM holds text that is no number: it is damaged") from None
    if len(values) < count:
        raise MapFileError(f"{path}: the PGM ends after {len(values)} of {count} pixels: it is cut off")
    return MapImage(np.minimum(values, maximum).reshape(rows, cols, 1), maximum)


def _decode(path: Path, content: bytes) -> MapImage:
    import cv2  # noqa: PLC0415  # slow to load, and most maps are PGM

    if content.startswith(_PNG_SIGNATURE):
        _check_png_chunks(path, content)
    level = cv2.utils.logging.setLogLevel(
        cv2.utils.logging.LOG_LEVEL_SILENT
    )  # without a second message of OpenCV for a damaged file
    try:
        pixels = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:  # empty, or more pixels than OpenCV allows
        pixels = None
    finally:
        cv2.utils.logging.setLogLevel(level)
    if pixels is None:
        raise MapFileError(f"{path}: cannot be decoded: it is damaged, or its format is unknown: save it as PGM or PNG")
    if pixels.dtype not in {np.dtype(np.uint8), np.dtype(np.uint16)}:
        raise MapFileError(f"{path}: has {pixels.dtype} pixels: save it with 8 or 16 bits")
    rows, cols = pixels.shape[:2]
    check_size(path, rows, cols)
    return MapImage(pixels.reshape(rows, cols, -1), 255 if pixels.dtype == np.uint8 else 65535)


def _check_png_chunks(path: Path, content: bytes) -> None:
    """Check a PNG's checksums: libpng reports damage on stderr only, and may return a partial picture."""
    start, kind = len(_PNG_SIGNATURE), b""
    while kind != b"IEND":
        length, kind = int.from_bytes(content[start : start + 4], "big"), content[start + 4 : start + 8]
        end = start + 8 + length
        checksum = content[end : end + 4]
        if len(checksum) < 4 or zlib.crc32(content[start + 4 : end]) != int.from_bytes(checksum, "big"):
            raise MapFileError(f"{path}: is damaged or cut off: fetch the picture again")
        start = end + 4


Mode = Literal["trinary", "scale", "raw"]
Alpha = Literal["unknown", "average"]

OCCUPIED_THRESHOLD = 0.65
FREE_THRESHOLD = 0.196
"""nav2's own saver writes 0.25, and then the pixel 205 of unknown cells, 50/255 = 0.19608, is free when read again."""


@dataclass(frozen=True)
class PixelRule:
    """The meaning of the values of pixels."""

    negate: bool = False
    """Whether white means occupied."""
    occupied_threshold: float = OCCUPIED_THRESHOLD
    free_threshold: float = FREE_THRESHOLD
    """Occupancies above and below which a pixel counts as occupied and free."""
    mode: Mode = "trinary"
    """Pixels are free, occupied or unknown (trinary), or also occupancies in between (scale), or occupancies (raw)."""
    alpha: Alpha = "unknown"
    """In trinary mode, whether pixels that are not opaque are unknown, or alpha is averaged with the colours."""

    @property
    def averages_alpha(self) -> bool:
        """Whether alpha is averaged with the colours."""
        return self.mode == "trinary" and self.alpha == "average"


def occupancy_of_image(image: MapImage, rule: PixelRule) -> npt.NDArray[np.int8]:
    """Return the occupancy (rows, cols) that map_server publishes: 0 to 100, -1 unknown; row grows with y.

    Colours are averaged. Transparent pixels are unknown except in raw mode, as in nav2_map_server since pull request
    5071 (2025). Earlier versions and ROS 1 averaged alpha with the colours in trinary mode: `alpha: average` in the
    yaml.
    """
    sums, white = image.channel_sum(with_alpha=rule.averages_alpha)
    # A pixel's occupancy depends only on the sum of its channels, so it is looked up in a table.
    occupancy = _occupancies(np.arange(white + 1), white, rule)[sums]
    if image.alpha is not None and rule.mode != "raw" and not rule.averages_alpha:
        occupancy[image.alpha < image.maximum] = -1
    return np.ascontiguousarray(occupancy[::-1])


def _occupancies(sums: npt.NDArray[np.int64], white: int, rule: PixelRule) -> npt.NDArray[np.int8]:
    if rule.mode == "raw":
        percent = np.floor(sums / white * 255.0 + 0.5)
        return np.where(percent <= 100.0, percent, -1.0).astype(np.int8)
    p = (sums if rule.negate else white - sums) / white
    low, high = rule.free_threshold, rule.occupied_threshold
    between = np.rint((p - low) / (high - low) * 100.0) if rule.mode == "scale" else -1.0
    return np.where(p > high, 100.0, np.where(p < low, 0.0, between)).astype(np.int8)
