"""Texts from outside, read strictly: whole files, JSON, and what an order may hold.

A file is never a pipe or a device, whose end may never come, nor read without a limit. JSON is of a limited size and
depth, its numbers finite, its characters whole; an order is one object of it, its numbers in their range, its token the
right one. What reads JSON raises nothing but InputError.

For orders over the page, the terminals and Signal K, for the files that a boat sends, and for the headers of logs,
which anybody may have written. Python's own reader takes NaN and halves of characters, with which no answer can be
written, and fails with a RecursionError.
"""

from __future__ import annotations

import codecs
import errno
import json
import math
import os
import re
import stat
from array import array
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

from autopilot.errors import InputError
from autopilot.files.printable import printable

SIZE_MOST = 4 << 30
"""Bytes of the largest file that is read whole: days of any log."""
UNNAMED = 1 << 20
"""Bytes that are asked for of a file that tells no size, as those of /proc."""


def open_regular(path: str | Path) -> int:
    """Return a descriptor to read a regular file. Raises OSError for what is none; waits for nobody."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    mode = os.fstat(descriptor).st_mode
    if stat.S_ISREG(mode):
        return descriptor
    os.close(descriptor)
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    raise OSError(errno.EINVAL, "Not a file but a pipe, socket or device")


def read_regular(path: str | Path, most: int = SIZE_MOST) -> bytes:
    """Return what a regular file holds as it is opened, at most `most` bytes of it.

    Raises OSError, also beyond SIZE_MOST and where the memory is too small for it.
    """
    with open(open_regular(path), "rb") as file:
        size = os.fstat(file.fileno()).st_size
        if most >= SIZE_MOST and size > SIZE_MOST:
            raise OSError(errno.EFBIG, os.strerror(errno.EFBIG))
        try:
            # no more than there is: all that is asked for is reserved before anything is read
            return file.read(min(most, size or UNNAMED))
        except MemoryError:
            raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM)) from None


BLOCK = 1 << 20
"""Bytes of a text that are looked at together."""
UNICODE = (
    (rb"\xff\xfe\0\0|\0\0\xfe\xff", "utf-32"),
    (rb"\xff\xfe|\xfe\xff", "utf-16"),
    (rb"(?:[\t\r\n -~]\0){8}", "utf-16-le"),
    (rb"(?:\0[\t\r\n -~]){8}", "utf-16-be"),
)
"""How texts in other encodings than UTF-8 begin: with their byte order mark, or every other byte a zero."""


def utf8_blocks(path: str | Path, size: int = BLOCK) -> Iterator[bytes]:
    """Yield what a regular file holds in blocks of `size` bytes, BLOCK at most, as `as_utf8` has it.

    Raises OSError, also beyond SIZE_MOST, and UnicodeDecodeError.
    """
    size = min(size, BLOCK)
    with open(open_regular(path), "rb") as file:
        if os.fstat(file.fileno()).st_size > SIZE_MOST:
            raise OSError(errno.EFBIG, os.strerror(errno.EFBIG))
        block = file.read(size).removeprefix(codecs.BOM_UTF8)
        decoder = _decoder_of(block)
        while block:
            yield block if decoder is None else decoder.decode(block).encode()
            block = file.read(size)


def as_utf8(data: bytes) -> bytes:
    """Return a text in UTF-16 or UTF-32 in UTF-8, without a last character that is cut off, and all else as it is; a
    byte order mark is left out.

    Raises UnicodeDecodeError.
    """
    decoder = _decoder_of(data)
    return data.removeprefix(codecs.BOM_UTF8) if decoder is None else decoder.decode(data).encode()


def _decoder_of(data: bytes) -> codecs.IncrementalDecoder | None:
    for beginning, encoding in UNICODE:
        if re.match(beginning, data):
            return codecs.getincrementaldecoder(encoding)()
    return None


def whole_lines(blocks: Iterable[bytes]) -> Iterator[bytes]:
    """Yield the same bytes in blocks that end where a line does (\\n, \\r or \\r\\n), the last one wherever it does."""
    held: list[bytes] = []
    for block in blocks:
        # one \r at the end may be half of an end
        end = max(block.rfind(b"\n"), block.rfind(b"\r", 0, -1)) + 1
        if end:
            yield b"".join((*held, block[:end]))
            held = []
        held.append(block[end:])
    if rest := b"".join(held):
        yield rest


class ByteRows:
    """Bytes of many lengths, in a row: of millions an object for each takes several times what they hold."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._ends = array("q", (0,))

    def append(self, data: bytes) -> None:
        """Append one more."""
        self._data += data
        self._ends.append(len(self._data))

    def __len__(self) -> int:
        return len(self._ends) - 1

    def __getitem__(self, at: int) -> bytes:
        place = range(len(self))[at]
        return bytes(self._data[self._ends[place] : self._ends[place + 1]])

    def __iter__(self) -> Iterator[bytes]:
        return (bytes(self._data[begin:end]) for begin, end in pairwise(self._ends))


def alike(path: str | Path) -> str:
    """Return "; did you mean X?" for the file beside `path` whose name comes nearest; "" where none does."""
    from difflib import get_close_matches  # only a mistake needs it

    wanted = Path(path)
    try:
        names = [each.name for each in wanted.parent.iterdir() if each.is_file()]
    except OSError:
        return ""
    found = get_close_matches(wanted.name, names, n=1)
    return f"; did you mean {printable(found[0], SHOWN)}?" if found else ""


DEEPEST = 32
"""Lists and objects in one another; what we read and write has at most five."""
DIGITS_MOST = 18
"""A whole number of more digits is read as a float, which may be infinite."""


def parse_json(data: bytes, origin: str, most: int) -> Any:
    """Return what `data`, of at most `most` bytes, says; `origin` begins the sentence of refusal. Raises InputError."""
    if len(data) > most:
        raise InputError(f"{origin}: {len(data)} bytes, at most {most} are allowed")
    try:
        found = json.loads(data.decode(), parse_int=_whole, parse_constant=_no_json)
    except ValueError as error:
        raise InputError(f"{origin}: no JSON in UTF-8 ({error})") from None
    except RecursionError:
        raise _too_deep(origin) from None
    _check(found, origin)
    return found


def _check(found: Any, origin: str) -> None:
    """Raise InputError where `found` holds what cannot be written again, or is too deep; level by level."""
    level = [found]
    for _ in range(DEEPEST + 1):
        for each in level:
            if isinstance(each, str) and not _is_whole(each):
                raise InputError(f"{origin}: half of a character in it, which no text may have")
            if isinstance(each, float) and not math.isfinite(each):
                raise InputError(f"{origin}: a number in it is too large; write finite numbers")
        inside = [each for each in level if isinstance(each, dict | list)]
        if not inside:
            return
        level = [each for holder in inside for each in holder]
        level += [each for holder in inside if isinstance(holder, dict) for each in holder.values()]
    raise _too_deep(origin)


def _is_whole(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def _too_deep(origin: str) -> InputError:
    return InputError(f"{origin}: nested deeper than {DEEPEST}")


def _whole(digits: str) -> float:
    return int(digits) if len(digits) <= DIGITS_MOST else float(digits)


def _no_json(name: str) -> float:
    raise ValueError(f"{name} is no number")


SHOWN = 40
"""Characters of a wrong value that a refusal quotes."""
ORDER_MOST = 4096
"""Bytes of an order."""
TYPED = re.compile(r"[+-]?([0-9]{1,20}\.?[0-9]{0,20}|\.[0-9]{1,20})([eE][+-]?[0-9]{1,3})?")


def order_object(data: bytes) -> dict[str, Any]:
    """Return the JSON object that `data` is. Raises InputError."""
    found = parse_json(data, "an order is one object of JSON", ORDER_MOST)
    if not isinstance(found, dict):
        raise InputError("an order is one object of JSON: {...}")
    return found


def number_from(value: object, what: str, low: float, high: float) -> float:
    """Return a value as a number from `low` to `high`. Raises InputError, which names `what` it is."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if low <= number <= high and math.isfinite(number):
            return number
    raise InputError(f"{what} {printable(repr(value), SHOWN)}: a number from {low:g} to {high:g} is allowed")


def typed_number(text: str) -> float:
    """Return the finite number that a person has typed, such as 90, -1.5, 1e-3. Raises InputError."""
    number = float(text) if TYPED.fullmatch(text) else math.nan
    if not math.isfinite(number):
        raise InputError(f"{printable(repr(text), SHOWN)} is not a number")
    return number


def is_same_token(given: object, token: str) -> bool:
    """Return whether `given` is the token, which is not empty, in a time that says nothing of how far it is right."""
    if not isinstance(given, str) or not token:
        return False
    import hmac

    return hmac.compare_digest(given.encode("utf-8", "surrogatepass"), token.encode())
