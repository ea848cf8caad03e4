"""Text of foreign origin made fit for a terminal: one line, nothing in it that a terminal obeys, and short.

Names in files, STATUSTEXT of a vehicle, NMEA sentences and what strangers send may hold escape sequences (C0, C1),
marks that turn the direction of writing, and halves of characters that no encoding has. They are shown as Python writes
them. Beside it the two forms in which commands print what they found: a table, and JSON.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import os
import re
import sys
from collections.abc import Collection, Iterator, Sequence

TYPE_CHECKING = False  # see `autopilot`
if TYPE_CHECKING:
    from typing import Any, TextIO

SHORT = 200
"""Characters of a foreign text that a sentence quotes."""
SENTENCE = 2000
"""Characters, at most, of a sentence that a command ends with."""
WORD, CUT = 400, 100
"""A word longer than WORD is cut to its first CUT characters."""
LONG = 1.0e9
"""Numbers from this on are shown in powers of ten."""
WIDEST = 80
"""Columns of the terminal that everybody has."""
NARROWEST = 40
"""Columns of a terminal on which lines are broken between words."""
GROUP = 48
"""Characters, at most, of words between two blanks that stay on one line, such as a key and what it does."""
KEPT = "\n\t"
"""What our own lines and tables are made with."""


def escaped(text: str, keep: str = "") -> str:
    """Return `text` with every character that is not printable, but those of `keep`, as an escape: ESC becomes \\x1b.

    Not printable are the categories C (control, format, surrogate, private, unassigned) and Z but the space.
    """
    if text.isprintable():
        return text
    return "".join(each if each.isprintable() or each in keep else repr(each)[1:-1] for each in text)


def shortened(text: str, most: int = SHORT) -> str:
    """Return at most `most` characters of `text`, and behind them how many there were, where that is more."""
    return text if len(text) <= most else f"{text[:most]}... ({len(text)} characters)"


def brief(sentence: str) -> str:
    """Return a sentence with what is long in it cut: words of foreign origin, and at last its middle."""
    if len(sentence) <= WORD:
        return sentence
    cut = _LONG_WORD.sub(lambda word: shortened(word[0], CUT), sentence)
    if len(cut) <= SENTENCE:
        return cut
    return f"{cut[: SENTENCE - 2 * CUT]} ... ({len(sentence)} characters) ... {cut[-CUT:]}"


def printable(value: object, most: int = SHORT) -> str:
    """Return a foreign value on one short line that a terminal shows and does not obey."""
    return escaped(shortened(value if isinstance(value, str) else repr(value), most))


def fixed(value: float, places: int, sign: str = "") -> str:
    """Return a number with so many decimals, or where that would be long in powers of ten; sign: '+' to show it."""
    return f"{value:{sign}.{places}f}" if abs(value) < LONG else f"{value:{sign}.3g}"


def aligned(rows: Sequence[Sequence[str]], right: Collection[int] = (), has_head: bool = True) -> list[str]:
    """Return the rows of a table, one each: columns flush left, those of `right` flush right. The first row holds the
    names of the columns where it `has_head`.

    Where they would be wider than a terminal, the names of the columns stand in several lines; where that is not
    enough, so do the cells that are flush left, the widest column first. No word is broken.
    """
    cells = [[[cell] for cell in row] for row in rows]
    left = sorted(set(range(len(rows[0]))) - set(right))
    if sum(_widths(cells)) + 2 * (len(rows[0]) - 1) > WIDEST:
        for place, cell in enumerate(rows[0] if has_head else ()):
            least = max(map(len, cell.split()), default=0)
            cells[0][place] = _lines(cell, max([least, *(len(row[place]) for row in rows[1:])]))
    widths = _widths(cells)
    longest = {
        place: max(len(word) for row in cells for line in row[place] for word in ["", *line.split()]) for place in left
    }
    while sum(widths) + 2 * (len(widths) - 1) > WIDEST:
        wide = [place for place in left if widths[place] > longest[place]]
        if not wide:
            break
        widths[max(wide, key=lambda place: widths[place])] -= 1
    for row in cells:
        for place in left:
            row[place] = [line for each in row[place] for line in _lines(each, widths[place])]
    widths = _widths(cells)
    text = []
    for at, row in enumerate(cells):
        deepest = max(map(len, row))
        # a head stands above its numbers, a cell beside the beginning of the others
        filled = [[""] * (deepest - len(cell)) + cell if at == 0 and has_head else cell for cell in row]
        lines = [
            "  ".join(
                line.rjust(width) if place in right else line.ljust(width)
                for place, (line, width) in enumerate(zip(line_of_cells, widths, strict=True))
            ).rstrip()
            for line_of_cells in itertools.zip_longest(*filled, fillvalue="")
        ]
        text.append("\n".join(lines))
    return text


def _widths(cells: list[list[list[str]]]) -> list[int]:
    return [max(len(line) for cell in column for line in cell) for column in zip(*cells, strict=True)]


def _lines(cell: str, width: int) -> list[str]:
    """Return the lines of a cell, none longer than its longest word or `width`."""
    if len(cell) <= width:
        return [cell]
    import textwrap  # few tables are that wide

    return textwrap.wrap(cell, max(width, 1), break_long_words=False, break_on_hyphens=False) or [""]


_LONG_WORD = re.compile(rf"\S{{{WORD + 1},}}")


_NO_PROSE = re.compile(r"""\s*[{\["'$]| {13}|.*(\S {2}|\t)""")
"""Lines that are left as they are: JSON and tables."""
_TO_COPY = re.compile(r"\b(?:autopilot|sitl|pip|sudo) (?:(?![;,.:)](?: |$)).)*--(?:(?![;,.:)](?: |$)).)*")
"""A command with options, to the end of its clause: whoever copies it wants it in one line."""


def folded(text: str, width: int, hanging: int | None = None) -> str:
    """Return `text` with its prose broken between words at `width` characters, each line indented as it began; with
    `hanging` every line is broken, where it can be between groups parted by two blanks, and goes on behind so many."""
    lines = text.split("\n")
    for at, line in enumerate(lines):
        if len(line) > width and (hanging is not None or not _NO_PROSE.match(line)):
            import textwrap  # few lines are that long

            indent = " " * (len(line) - len(line.lstrip()) if hanging is None else hanging)
            line = _TO_COPY.sub(lambda command: command[0].replace(" ", "\xa0"), line)
            if hanging is not None:
                line = "  ".join(
                    each.replace(" ", "\xa0") if len(each) <= min(GROUP, width) else each for each in line.split("  ")
                )
            lines[at] = textwrap.fill(
                line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
            ).replace("\xa0", " ")
    return "\n".join(lines)


class PrintableStream:
    """A text stream for people, over `inside`: what is written comes out printable, line by line.

    What `inside` cannot encode comes out as escapes too, and ends nothing. On a terminal words stay whole.
    """

    def __init__(self, inside: TextIO) -> None:
        self.inside = inside

    def write(self, text: str) -> int:
        """Write `text`, line ends and tabs as they are."""
        shown = escaped(text, KEPT)
        if len(shown) > NARROWEST and (width := self._columns()) >= NARROWEST:
            shown = folded(shown, width)
        return self._put(text, shown)

    def write_file(self, text: str) -> int:
        """Write the `text` of a file: no line of it is broken, for whoever copies it."""
        return self._put(text, escaped(text, KEPT))

    def _put(self, text: str, shown: str) -> int:
        encoding = getattr(self.inside, "encoding", None) or "utf-8"
        if not shown.isascii():
            shown = shown.encode(encoding, "backslashreplace").decode(encoding)
        self.inside.write(shown)
        return len(text)

    def _columns(self) -> int:
        """Return the width of the terminal, 0 where it is none."""
        try:
            return os.get_terminal_size(self.inside.fileno()).columns
        except (AttributeError, OSError, ValueError):
            return 0

    def writelines(self, lines: Any) -> None:
        """Write each."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inside, name)


def print_file(text: str) -> None:
    """Print the text of a file as it is."""
    out = sys.stdout
    (out.write_file if isinstance(out, PrintableStream) else out.write)(text)


@contextlib.contextmanager
def printable_output() -> Iterator[None]:
    """Keep what is printed printable while the block lasts, on the standard output and error output."""
    out, error = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = _wrapped(out), _wrapped(error)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = out, error


def _wrapped(stream: Any) -> Any:
    return stream if stream is None or isinstance(stream, PrintableStream) else PrintableStream(stream)


def terminal_of(stream: Any) -> Any:
    """Return the stream that takes our own control characters: the one inside, where foreign text is kept printable."""
    return stream.inside if isinstance(stream, PrintableStream) else stream


def rewrite_line(stream: Any, line: str, end: str = "") -> None:
    """Write `line` over the present line of a terminal."""
    terminal = terminal_of(stream)
    shown = escaped(line, KEPT).replace("\n", "\033[K\n")  # of a text of several lines too none is left of what stood
    terminal.write(f"\r{shown}\033[K{end}")
    terminal.flush()


def json_text(found: Any, indent: int | None = 2) -> str:
    """Return `found`, of dicts, sequences, texts, numbers and None, as JSON that every reader takes: null
    where a number is not finite, for JSON has no word for that."""
    import json  # few print it

    return json.dumps(_with_null(found), indent=indent, allow_nan=False)


def _with_null(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _with_null(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_with_null(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
