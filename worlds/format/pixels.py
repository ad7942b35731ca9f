# SPDX-License-Identifier: MIT
"""Read the grey values of a picture of a map."""

from __future__ import annotations

import io
import re
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFile, UnidentifiedImageError

from worlds.errors import MapFileError

_FORMATS = ("PPM", "PNG", "BMP", "TIFF", "JPEG", "GIF", "WEBP", "TGA")
"""Pillow's names of the formats that are read; others, such as EPS, start programs or are no pictures of maps."""
_LOSSY = ("JPEG", "WEBP")
_BEFORE_RASTER = re.compile(rb"(?:(?<=\r)\n|(?<=[\r\n])#[^\n]*\n)+")
"""What some programs write between the largest value of a binary PGM and its pixels: the second sign of an end of line
of Windows, and comments."""
_MIN_OPAQUE = 128
"""Pixels with a smaller alpha value count as transparent."""


@dataclass(frozen=True, eq=False)
class Pixels:
    """Grey values of a picture."""

    grey: NDArray[np.uint8] | NDArray[np.uint16]
    """Grey values, (rows, cols), top row first; of coloured pixels the mean of red, green and blue."""
    white: int
    """Grey value of white: 255 or 65535."""
    transparent: NDArray[np.bool_] | None
    """Pixels that are mostly transparent, (rows, cols); None in a picture without transparency."""
    lossy: bool = False
    """The format blurs greys."""


def read_pixels(path: Path, *, max_pixels: int) -> Pixels:
    """Read a PGM (plain or binary), PNG, BMP, TIFF, JPEG, GIF, WebP or TGA picture; of several frames the first.

    Values are scaled to 0 to 255, or to 0 to 65535 for pictures of 16 bits; such pictures with values up to 255 only
    count as pictures of 8 bits.
    Raises MapFileError, naming the file, for anything else, a damaged picture, a value above the largest one that the
    picture states, and more than `max_pixels` pixels, before any memory is taken for them.
    """
    too_large = f"more than the limit of {max_pixels:,} pixels"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the limit below holds
            image = Image.open(path, formats=_FORMATS)
        with image:
            if image.width * image.height > max_pixels:
                raise MapFileError(f"{path}: {image.width} x {image.height} pixels are {too_large}")
            if image.width * image.height == 0:
                raise MapFileError(f"{path}: expected a picture with at least one pixel")
            if (sound := _without_lines_before_raster(path, image)) is not None:
                return _pixels_of(path, sound)
            _check_largest_value(path, image)
            return replace(_pixels_of(path, image), lossy=image.format in _LOSSY)
    except UnidentifiedImageError:
        raise MapFileError(f"{path}: expected a picture: PGM, PNG, BMP, TIFF, JPEG, GIF, WebP or TGA") from None
    except Image.DecompressionBombError:
        raise MapFileError(f"{path}: {too_large}") from None
    except MapFileError:
        raise
    except OSError as error:
        reason = error.strerror or str(error)
        raise MapFileError(f"{path}: {reason}, expected a picture of a map") from None
    except (ValueError, SyntaxError, EOFError, TypeError, IndexError, OverflowError) as error:
        raise MapFileError(f"{path}: {error}, expected a picture of a map") from None


def _without_lines_before_raster(path: Path, image: ImageFile.ImageFile) -> Image.Image | None:
    """Return a binary PGM without what stands between its header and its pixels, which would shift them; None where
    nothing does, that is, where the file has no bytes to spare."""
    is_grey = image.mode == "L" or image.mode.startswith("I")
    if image.format != "PPM" or image.tile[0].codec_name not in ("raw", "ppm") or not is_grey:
        return None
    size = image.width * image.height * (1 if image.mode == "L" else 2)
    content, begin = path.read_bytes(), image.tile[0].offset
    found = _BEFORE_RASTER.match(content, begin)
    if found is None or content[found.end() + size :].strip() or len(content) < found.end() + size:
        return None
    return Image.open(io.BytesIO(content[:begin] + content[found.end() :]), formats=("PPM",))


def _check_largest_value(path: Path, image: ImageFile.ImageFile) -> None:
    """Raise MapFileError where a binary PGM holds values above the largest one that it states; Pillow clips them."""
    if image.format != "PPM" or image.tile[0].codec_name != "ppm":
        return
    arguments = image.tile[0].args
    assert isinstance(arguments, tuple)  # mode and largest value
    largest = int(arguments[-1])
    with path.open("rb") as file:
        file.seek(image.tile[0].offset)
        values = np.frombuffer(file.read(), dtype=np.uint8 if largest < 256 else ">u2")
    if values.size and values.max() > largest:
        raise MapFileError(f"{path}: a value of {values.max()}, expected at most {largest}, the white of this picture")


def _pixels_of(path: Path, image: Image.Image) -> Pixels:
    if image.mode == "F":
        raise MapFileError(f"{path}: a picture of floating-point numbers, expected grey values")
    if image.mode.startswith("I"):
        values = np.asarray(image).astype(np.int64)
        if values.min() < 0 or values.max() > 65535:
            raise MapFileError(f"{path}: grey values of {values.min()} to {values.max()}, expected 0 to 65535")
        if values.max() <= 255:  # greys of 8 bits that were saved as 16: else all would be black
            return Pixels(values.astype(np.uint8), 255, None)
        return Pixels(values.astype(np.uint16), 65535, None)
    if image.has_transparency_data:
        channels = np.asarray(image.convert("RGBA"))
        return Pixels(_mean(channels[..., :3]), 255, channels[..., 3] < _MIN_OPAQUE)
    if image.mode in ("1", "L"):
        return Pixels(np.asarray(image.convert("L")), 255, None)
    return Pixels(_mean(np.asarray(image.convert("RGB"))), 255, None)


def _mean(channels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the rounded mean of three channels (rows, cols, 3)."""
    total = channels[..., 0].astype(np.uint16) + channels[..., 1] + channels[..., 2]
    return ((total + 1) // 3).astype(np.uint8)
