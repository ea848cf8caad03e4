"""`python -m sitl` is the `sitl` command, and how it is started."""

from autopilot.entry import start


def main() -> None:
    """Run `sitl` and end with its exit code."""
    start("sitl", _sitl)


def _sitl() -> int:
    from sitl.cli import main as sitl

    return sitl()


if __name__ == "__main__":
    main()
