"""`python -m sitl` is the `sitl` command, and how it is started."""

from autopilot.__main__ import start


def main(program: str = "sitl") -> None:
    """Run `sitl` and end with its exit code; its messages name `program`, which may have called it."""

    def run() -> int:
        from sitl.cli import main as sitl

        return sitl(program=program)

    start(program, run)


if __name__ == "__main__":
    main()
