"""A real browser without a window, for pages that people open."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")


class OpenPage:
    """A page from disk in a browser without a network, and everything it complained of or asked for."""

    def __init__(self, page, path: Path) -> None:
        self.page, self.complaints, self.requests = page, [], []
        page.on("console", lambda message: self.complaints.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", lambda request: self.requests.append(request.url))
        page.goto(path.resolve().as_uri())

    def asked_elsewhere(self) -> list[str]:
        """Return what was requested beyond the file itself and what it holds."""
        return [url for url in self.requests[1:] if not url.startswith("data:")]

    def visible_rasters(self) -> list[str]:
        """Return the labels of the pictures on the map."""
        return [image.get_attribute("alt") for image in self.page.locator("#map img.leaflet-image-layer").all()]


@contextmanager
def running_browser() -> Iterator[object]:
    """Run a browser; skip the test where there is none.

    It is closed at the end since the library's event loop must not run while other tests use one.
    """
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install '.[dev]'")
    path = next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        pytest.skip(f"no browser is installed: none of {', '.join(NAMES)} is found, apt-get install chromium")
    with playwright.sync_playwright() as tool:
        browser = tool.chromium.launch(executable_path=path)
        yield browser
        browser.close()


@contextmanager
def browser_window(browser, width: int = 1440, height: int = 900, *, is_touched: bool = False) -> Iterator[object]:
    """Open a window that knows nothing of others, of a phone if it is touched."""
    context = browser.new_context(
        viewport={"width": width, "height": height}, offline=True, is_mobile=is_touched, has_touch=is_touched
    )
    yield context.new_page()
    context.close()
