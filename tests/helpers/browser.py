"""Debian's chromium, headless, driven by Playwright; tests that need it skip where either is absent."""

import io
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jaxtyping import UInt8
from PIL import Image

# software rendering: there is no graphics card where tests run
ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
PATIENCE = 120_000  # milliseconds, on a machine that does other things as well


@contextmanager
def chromium(*more: str) -> Iterator[Any]:
    """The browser, with more arguments of the command line, or skip the test."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs Playwright: make setup installs it")
    found = shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        pytest.skip("needs chromium: apt-get install chromium")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=found, headless=True, args=[*ARGUMENTS, *more])
        yield browser
        browser.close()


class Opened:
    """A page that was opened from disk, and what it complained about or asked the network for."""

    def __init__(self, browser: Any, path: Path, said: str = "", **options: Any) -> None:
        self.context = browser.new_context(**{"viewport": {"width": 256, "height": 256}, **options})
        self.page: Any = self.context.new_page()
        self.page.set_default_timeout(PATIENCE)
        self.trouble: list[str] = []
        self.page.on("console", lambda message: self._heard(message.type, message.text))
        self.page.on("pageerror", lambda error: self.trouble.append(str(error)))
        self.page.on("request", lambda request: self._asked(request.url))
        self.page.goto(f"{path.resolve().as_uri()}#{said}")
        self.page.wait_for_selector("body[data-ready]", state="attached")

    def _heard(self, kind: str, text: str) -> None:
        # the last: that reading pixels back is slow, which a software renderer says of any read
        if kind in ("error", "warning") and "GPU stall due to ReadPixels" not in text:
            self.trouble.append(text)

    def _asked(self, url: str) -> None:
        if not url.startswith(("file:", "data:", "blob:")):
            self.trouble.append(f"asked for {url}")

    def say(self, address: str) -> None:
        """Give the page another address and wait for its picture."""
        self.page.evaluate(
            # the page hears of it by an event, and timers may run before that
            """said => new Promise(done => {
                const before = location.hash;
                location.hash = said;
                if (location.hash === before) done();
                else addEventListener("hashchange", () => done(), { once: true });
            })""",
            address,
        )
        self.settle()

    def settle(self) -> None:
        """Wait until what was asked for is drawn."""
        self.page.evaluate(
            "new Promise(done => setTimeout(() => requestAnimationFrame(() => requestAnimationFrame(done))))"
        )

    def picture(self) -> UInt8[np.ndarray, "h w 3"]:
        """What the canvas shows."""
        self.settle()
        return np.asarray(Image.open(io.BytesIO(self.page.locator("#picture").screenshot())).convert("RGB"))

    def address(self) -> dict[str, str]:
        """What the address says, once it is up to date."""
        self.page.wait_for_timeout(500)
        words = self.page.evaluate("location.hash").removeprefix("#")
        return dict(word.split("=", 1) for word in words.split("&"))

    def close(self) -> None:
        """Close the page. Raises AssertionError if it complained or asked the network for anything."""
        self.context.close()
        assert self.trouble == []
