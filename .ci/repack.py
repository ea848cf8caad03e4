"""Compress the files of a wheel again, as small as deflate gets them: `.ci/release` calls this.

Zopfli looks longer for what repeats; what it writes every program reads. The same wheel gives the same bytes.
"""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path

import zopfli.zlib


class Zopfli:
    """What `zipfile` asks of a compressor; a zlib stream less its head of 2 and its sum of 4 bytes is bare deflate."""

    def __init__(self, *_: object) -> None:
        self._data = b""

    def compress(self, data: bytes) -> bytes:
        self._data += data
        return b""

    def flush(self) -> bytes:
        return zopfli.zlib.compress(self._data)[2:-4]


def repack(wheel: Path) -> None:
    smaller = wheel.with_suffix(".smaller")
    zipfile._get_compressor = Zopfli  # no option of zipfile takes another one
    with zipfile.ZipFile(wheel) as given, zipfile.ZipFile(smaller, "w") as made:
        for each in given.infolist():
            made.writestr(each, given.read(each))
    with zipfile.ZipFile(wheel) as given, zipfile.ZipFile(smaller) as made:
        assert [made.read(name) for name in made.namelist()] == [given.read(name) for name in given.namelist()]
    smaller.replace(wheel)


repack(Path(sys.argv[1]))
