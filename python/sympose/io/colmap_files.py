"""The files of a COLMAP model, binary and text, as records; what they mean is for `sympose.io.colmap`.

Read with NumPy alone: the formats are simple, and pycolmap brings native libraries into the process that can
clash with others.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sympose.errors import InvalidInputError

__all__ = ["ColmapCamera", "ColmapImage", "ColmapPoints", "read_binary", "read_text", "read_visibility"]

# COLMAP's models in the order of their numbers, each with the count of its parameters.
_MODELS = (
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
)
_COUNT = struct.Struct("<Q")
_LENGTH = struct.Struct("<I")
_CAMERA = struct.Struct("<IiQQ")
_IMAGE = struct.Struct("<I7dI")
_POINT = struct.Struct("<Q3d3BdQ")
_POINT_2D_SIZE = struct.calcsize("<ddq")
_LARGEST = 2**63 - 1
_TRACK = np.dtype([("image", "<u4"), ("point_2d", "<u4")])


@dataclass(frozen=True)
class ColmapCamera:
    """A camera; `parameters` in COLMAP's order for its model."""

    number: int
    model: str
    width: int
    height: int
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class ColmapImage:
    """An image and its pose, camera from world."""

    number: int
    quaternion: tuple[float, ...]  # w x y z
    translation: tuple[float, ...]
    camera: int
    name: str


@dataclass(frozen=True)
class ColmapPoints:
    """All points; `track_images` holds the numbers of the images of all tracks, one track after the other."""

    xyz: NDArray[np.float64]  # (N, 3)
    rgb: NDArray[np.uint8]  # (N, 3)
    track_lengths: NDArray[np.int64]  # (N,)
    track_images: NDArray[np.int64]  # (sum of the lengths,)


Model = tuple[list[ColmapCamera], list[ColmapImage], ColmapPoints]


def read_binary(cameras_path: Path, images_path: Path, points_path: Path) -> Model:
    """Read cameras.bin, images.bin and points3D.bin.

    Raises:
        InvalidInputError: A file is cut off, too long, or something else.
    """
    cameras = []
    stream = _Bytes(cameras_path)
    for _ in stream.records():
        number, model, width, height = (int(value) for value in stream.take(_CAMERA))
        if not 0 <= model < len(_MODELS):
            raise InvalidInputError(
                f"{cameras_path}: not a COLMAP file, or an unknown camera model ({model})"
            )
        name, count = _MODELS[model]
        cameras.append(ColmapCamera(number, name, width, height, stream.take(struct.Struct(f"<{count}d"))))

    images = []
    stream = _Bytes(images_path)
    for _ in stream.records():
        image, *pose, camera = stream.take(_IMAGE)
        name = stream.take_name()
        stream.skip(int(stream.take(_COUNT)[0]) * _POINT_2D_SIZE)
        images.append(ColmapImage(int(image), tuple(pose[:4]), tuple(pose[4:]), int(camera), name))

    xyz, rgb, lengths, tracks = [], [], [], []
    stream = _Bytes(points_path)
    for _ in stream.records():
        _, x, y, z, red, green, blue, _, length = stream.take(_POINT)
        xyz.append((x, y, z))
        rgb.append((red, green, blue))
        lengths.append(int(length))
        tracks.append(stream.slice(int(length) * _TRACK.itemsize))
    track_images = np.frombuffer(b"".join(tracks), dtype=_TRACK)["image"]
    return cameras, images, _points(xyz, rgb, lengths, track_images)


def read_text(cameras_path: Path, images_path: Path, points_path: Path) -> Model:
    """Read cameras.txt, images.txt and points3D.txt.

    Raises:
        InvalidInputError: A line is not what COLMAP writes; the message gives its number.
    """
    cameras = []
    for line in _Lines(cameras_path):
        number, model, width, height, *parameters = line.words(minimum=5)
        cameras.append(
            ColmapCamera(
                line.integer(number),
                model,
                line.integer(width),
                line.integer(height),
                line.floats(parameters),
            )
        )

    # Two lines an image; the second, its points, may be empty.
    images = []
    for line in _Lines(images_path, skip_every_second=True):
        number, *pose, camera, name = line.words(minimum=10, maximum=10)
        numbers = line.floats(pose)
        images.append(
            ColmapImage(line.integer(number), numbers[:4], numbers[4:], line.integer(camera), name.strip())
        )

    xyz, rgb, lengths, tracks = [], [], [], []
    for line in _Lines(points_path):
        words = line.words(minimum=8)
        track = words[8:]
        if len(track) % 2 != 0:
            raise line.error("a track is made of pairs IMAGE_ID POINT2D_IDX")
        xyz.append(line.floats(words[1:4]))
        rgb.append([line.integer(word) for word in words[4:7]])
        lengths.append(len(track) // 2)
        tracks += [line.integer(word) for word in track[::2]]
    return cameras, images, _points(xyz, rgb, lengths, tracks)


def read_visibility(path: Path) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Read the `.ply.vis` file that COLMAP's stereo_fusion writes beside a cloud.

    Returns:
        For each point the number of images that saw it; and which these are, one point after the other, as
        places in the list of the images (COLMAP's `image_idx`), not their numbers.

    Raises:
        InvalidInputError: The file is cut off, too long, or something else.
    """
    stream = _Bytes(path)
    lengths, tracks = [], []
    for _ in stream.records():
        (length,) = stream.take(_LENGTH)
        lengths.append(int(length))
        tracks.append(stream.slice(_LENGTH.size * int(length)))
    return np.array(lengths, dtype=np.int64), np.frombuffer(b"".join(tracks), dtype="<u4").astype(np.int64)


def _points(xyz: object, rgb: object, lengths: object, track_images: object) -> ColmapPoints:
    return ColmapPoints(
        np.array(xyz, dtype=np.float64).reshape(-1, 3),
        np.array(rgb, dtype=np.int64).clip(0, 255).astype(np.uint8).reshape(-1, 3),
        np.array(lengths, dtype=np.int64),
        np.array(track_images, dtype=np.int64),
    )


class _Bytes:
    """The bytes of a binary file, taken from the front."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._bytes = path.read_bytes()
        self._offset = 0

    def records(self) -> Iterator[int]:
        """Count through the records of the file, and see to it that nothing follows the last."""
        (count,) = self.take(_COUNT)
        yield from range(int(count))
        left = len(self._bytes) - self._offset
        if left:
            raise InvalidInputError(
                f"{self._path}: not a COLMAP file: {left} bytes follow its {count} records"
            )

    def take(self, layout: struct.Struct) -> tuple[float, ...]:
        return layout.unpack_from(self._bytes, self.skip(layout.size))

    def take_name(self) -> str:
        end = self._bytes.find(b"\0", self._offset)
        if end < 0:
            raise InvalidInputError(f"{self._path}: not a COLMAP file or cut off: an image name does not end")
        return self.slice(end + 1 - self._offset)[:-1].decode("utf-8", errors="replace")

    def slice(self, size: int) -> bytes:
        start = self.skip(size)
        return self._bytes[start : start + size]

    def skip(self, size: int) -> int:
        """Pass over `size` bytes and return where they start."""
        start = self._offset
        left = len(self._bytes) - start
        if size > left:
            raise InvalidInputError(
                f"{self._path}: not a COLMAP file or cut off: {size} bytes are needed at byte {start}, "
                f"but {left} are left"
            )
        self._offset = start + size
        return start


@dataclass(frozen=True)
class _Line:
    """A line of a text file, which knows where it stands."""

    path: Path
    number: int
    text: str

    def error(self, message: str) -> InvalidInputError:
        return InvalidInputError(f"{self.path}, line {self.number}: {message}, got {self.text[:80]!r}")

    def words(self, minimum: int, maximum: int = 0) -> list[str]:
        words = self.text.split(maxsplit=maximum - 1)  # -1: no limit
        if len(words) < minimum:
            raise self.error(f"expected at least {minimum} words")
        return words

    def integer(self, word: str) -> int:
        try:
            number = int(word)
        except ValueError as error:
            raise self.error(f"expected a whole number for {word!r}") from error
        if not -_LARGEST <= number <= _LARGEST:
            raise self.error(f"{word} is too large for a number of COLMAP")
        return number

    def floats(self, words: list[str]) -> tuple[float, ...]:
        try:
            return tuple(float(word) for word in words)
        except ValueError as error:
            raise self.error(f"expected numbers: {error}") from error


class _Lines:
    """The lines of a text file without comments and empty ones; in images.txt also without each second."""

    def __init__(self, path: Path, skip_every_second: bool = False) -> None:
        self._path = path
        self._skip_every_second = skip_every_second

    def __iter__(self) -> Iterator[_Line]:
        try:
            text = self._path.read_text(encoding="utf-8")
        except UnicodeDecodeError as error:
            raise InvalidInputError(f"{self._path}: not a text file: {error.reason}") from error
        pass_over = False
        for number, line in enumerate(text.split("\n"), start=1):
            if line.startswith("#"):
                continue
            if pass_over:
                pass_over = False
            elif line.strip():
                pass_over = self._skip_every_second
                yield _Line(self._path, number, line)
