"""Take a picture of a report in a browser, for documentation."""

if __name__ == "__main__":  # before anything else is loaded, since Ctrl-C may come at once
    from tools.command_line.interruption import handle_interruption

    handle_interruption("screenshot")

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from tbmslam.io.atomic_file import write_bytes
from tools.command_line.paths import path_argument
from tools.command_line.program import ProgramParser, ended

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")

EXAMPLES = """examples:
  python tools/%(prog)s.py merged/report.html -o docs/report.png
      the first screen at a desktop's width
  python tools/%(prog)s.py merged/report.html -o pairs.png --element .cards --on keyframes overlap
      one part of the page, with further layers switched on

needs playwright (pip install 'tbmslam[dev]') and an installed Chromium or Chrome
"""


def parser() -> argparse.ArgumentParser:
    """Return the command line's grammar."""
    grammar = ProgramParser(prog="screenshot", description=__doc__, epilog=EXAMPLES)
    grammar.add_argument("page", type=path_argument, help="a report.html")
    grammar.add_argument("-o", "--out", type=path_argument, required=True, metavar="PNG", help="write the picture here")
    grammar.add_argument(
        "--size", type=int, nargs=2, default=(1440, 900), metavar=("W", "H"), help="of the window (1440 900)"
    )
    grammar.add_argument("--element", metavar="CSS", help="only the first part of the page that this selects")
    grammar.add_argument("--on", nargs="+", default=[], metavar="LAYER", help="layers to switch on, by their labels")
    grammar.add_argument("--off", nargs="+", default=[], metavar="LAYER", help="layers to switch off")
    return grammar


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; return its exit code."""
    options = parser().parse_args(arguments)
    return ended("screenshot", lambda: _take(options))


def _take(options: argparse.Namespace) -> int:
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        return _failed("no browser is installed: install chromium")
    if not options.page.is_file():
        return _failed(f"{options.page}: does not exist: give a report.html")
    try:
        from playwright.sync_api import Error, sync_playwright
    except ImportError:
        return _failed("playwright is not installed: pip install 'tbmslam[dev]'")
    width, height = options.size
    try:
        with sync_playwright() as tool:
            window = tool.chromium.launch(executable_path=browser).new_page(
                viewport={"width": width, "height": height}, offline=True
            )
            window.goto(options.page.resolve().as_uri())
            for label in options.on:
                window.get_by_label(label).check()
            for label in options.off:
                window.get_by_label(label).uncheck()
            window.wait_for_timeout(300)
            pictured = window.locator(options.element).first if options.element else window
            _save(pictured.screenshot(), options.out)
    except Error as error:
        return _failed(f"{options.page}: {error.message.splitlines()[0]}")
    return 0


def _save(png: bytes, path: Path) -> None:
    """Write a picture with 256 colours, which suffice for a page and give a small file."""
    import io

    from PIL import Image

    content = io.BytesIO()
    Image.open(io.BytesIO(png)).convert("RGB").quantize(256).save(content, "png", optimize=True)
    write_bytes(path, content.getvalue())


def _failed(message: str) -> int:
    print(f"screenshot: {message}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
