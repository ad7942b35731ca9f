# SPDX-License-Identifier: MIT
"""Pictures of maps: grey values as they are, in every format; anything else is refused in one line."""

import io

import numpy as np
import pytest
from PIL import Image

from tests.worlds.format.plans import p2, p5
from worlds.errors import MapFileError
from worlds.format.pixels import read_pixels

GREY = np.array([[0, 100, 205], [254, 255, 128]], np.uint8)
OPAQUE = np.array([[255, 255, 0], [255, 130, 20]], np.uint8)


def read(folder, content, name="map.pgm", max_pixels=1000):
    path = folder / name
    content.save(path) if isinstance(content, Image.Image) else path.write_bytes(content)
    return read_pixels(path, max_pixels=max_pixels)


@pytest.mark.parametrize(
    "content",
    [
        p5(GREY),
        p5(GREY, "# CREATOR: map_saver.cpp 0.050 m/pix\n# more\n"),
        p2(GREY),
        p2(GREY).replace(b"\n", b" # row\n"),
        b"P2 # text\n3 # w\n2\n255 0\t100\n205 # end of row\n 254 255 128",
    ],
)
def test_every_pgm_gives_its_grey_values(tmp_path, content):
    pixels = read(tmp_path, content)
    np.testing.assert_array_equal(pixels.grey, GREY)
    assert (pixels.white, pixels.transparent) == (255, None)


@pytest.mark.parametrize("before", [b"\r\n", b"\n# CREATOR: map_saver\n", b"\n# one\n# two\n", b"\r\n# of Windows\r\n"])
@pytest.mark.parametrize("behind", [b"", b"\n"])
@pytest.mark.parametrize("largest", [255, 65535])
def test_lines_between_header_and_pixels_shift_no_pixel(tmp_path, before, behind, largest):
    raster = GREY.tobytes() if largest == 255 else (GREY * np.uint16(257)).astype(">u2").tobytes()
    pixels = read(tmp_path, b"P5\n3 2\n" + str(largest).encode() + before + raster + behind)
    np.testing.assert_array_equal(pixels.grey, GREY * np.uint16(257) if largest == 65535 else GREY)


def test_a_pixel_that_looks_like_a_line_stays(tmp_path):
    grey = np.array([[10, 35, 10], [35, 10, 200]], np.uint8)
    np.testing.assert_array_equal(read(tmp_path, p5(grey) + b"\n").grey, grey)


@pytest.mark.parametrize("suffix", ["png", "bmp", "tif", "tga", "gif", "webp"])
def test_other_formats_give_the_same_values(tmp_path, suffix):
    if suffix == "webp":
        buffer = io.BytesIO()
        Image.fromarray(GREY).convert("RGB").save(buffer, "webp", lossless=True)
        np.testing.assert_array_equal(read(tmp_path, buffer.getvalue(), "map.webp").grey, GREY)
    else:
        np.testing.assert_array_equal(read(tmp_path, Image.fromarray(GREY), f"map.{suffix}").grey, GREY)


@pytest.mark.parametrize("mode", ["P", "RGB", "1"])
def test_palettes_and_colours_become_grey(tmp_path, mode):
    black_and_white = np.where(GREY < 128, 0, 255).astype(np.uint8)
    expected = black_and_white if mode == "1" else GREY
    picture = Image.fromarray(expected).convert(mode)
    np.testing.assert_array_equal(read(tmp_path, picture, "map.png").grey, expected)


def test_a_coloured_pixel_has_the_mean_of_its_channels(tmp_path):
    picture = Image.fromarray(np.array([[[255, 0, 0], [10, 20, 31]]], np.uint8))
    np.testing.assert_array_equal(read(tmp_path, picture, "map.png").grey, [[85, 20]])


def test_transparent_pixels_are_marked(tmp_path):
    with_alpha = Image.merge("LA", (Image.fromarray(GREY), Image.fromarray(OPAQUE)))
    pixels = read(tmp_path, with_alpha, "map.png")
    np.testing.assert_array_equal(pixels.grey, GREY)
    np.testing.assert_array_equal(pixels.transparent, OPAQUE < 128)
    buffer = io.BytesIO()
    Image.fromarray(GREY).save(buffer, "png", transparency=205)
    np.testing.assert_array_equal(read(tmp_path, buffer.getvalue(), "map.png").transparent, GREY == 205)


def test_values_are_scaled_to_the_white_of_the_picture(tmp_path):
    pixels = read(tmp_path, b"P2 3 1 10\n0 5 10\n")
    assert (pixels.grey.tolist(), pixels.white) == ([[0, 128, 255]], 255)
    pixels = read(tmp_path, b"P5 3 1 1000\n" + np.array([0, 500, 1000], ">u2").tobytes())
    assert (pixels.grey.tolist(), pixels.white) == ([[0, 32768, 65535]], 65535)
    pixels = read(tmp_path, Image.fromarray(np.array([[0, 70, 65535]], np.uint16)), "map.png")
    assert (pixels.grey.tolist(), pixels.white) == ([[0, 70, 65535]], 65535)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "expected a picture: PGM, PNG"),
        (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", "expected a picture: PGM, PNG"),
        (b"P5\n3 2\n255\n" + b"\0" * 5, "expected a picture of a map"),
        (b"P2\n2 2\n255\n1 2 3", "expected a picture of a map"),
        (b"P2\n2 2\n255\n1 2 x 4", "expected a picture of a map"),
        (b"P2\n2 1\n255\n1 -1\n", "value is negative: -1"),
        (b"P2\n2 1\n255\n1 70000\n", "value too large for this mode: 70000"),
        (b"P5\n2 1\n100\n\x64\x65", "a value of 101, expected at most 100"),
        (b"P5\n0 2\n255\n", "expected a picture"),
        (b"P5\n2 2\n70000\n", "expected a picture"),
        (b"P5\n40 30\n255\n", "40 x 30 pixels are more than the limit of 1,000"),
        (b"P5\n100000 100000\n255\n", "more than the limit of 1,000 pixels"),
        (b"\x89PNG\r\n\x1a\n" + b"\0" * 40, "expected a picture"),
    ],
)
def test_bad_pictures_are_refused_in_one_line(tmp_path, content, message):
    with pytest.raises(MapFileError, match=rf"map\.pgm: .*{message}") as caught:
        read(tmp_path, content)
    assert "\n" not in str(caught.value)


def test_a_picture_of_floats_is_refused(tmp_path):
    with pytest.raises(MapFileError, match="floating-point"):
        read(tmp_path, Image.fromarray(np.zeros((2, 2), np.float32)), "map.tif")


def test_a_missing_picture_is_named(tmp_path):
    with pytest.raises(MapFileError, match=r"gone\.png: No such file"):
        read_pixels(tmp_path / "gone.png", max_pixels=10)
