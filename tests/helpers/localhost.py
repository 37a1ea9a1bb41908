"""Pages of http://localhost/ that lie in folders here: modules and WebGPU want more than a file opened from disk."""

import mimetypes
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.helpers.browser import PATIENCE


@contextmanager
def page_of(browser: Any, folders: dict[str, Path], html: str) -> Iterator[Any]:
    """A page of this text; `/NAME/...` is what lies in the folder of that name. No request leaves the machine.

    Raises AssertionError at the end if the page complained.
    """
    page = browser.new_page()
    page.set_default_timeout(PATIENCE)
    trouble: list[str] = []
    page.on("pageerror", lambda error: trouble.append(str(error)))
    page.on("console", lambda message: trouble.append(message.text) if message.type == "error" else None)

    def answer(route: Any) -> None:
        name, _, rest = route.request.url.removeprefix("http://localhost/").partition("/")
        path = folders.get(name, Path("absent")) / rest
        if not name:
            route.fulfill(body=html, content_type="text/html")
        elif path.is_file():
            kind = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
            route.fulfill(body=path.read_bytes(), content_type=kind)
        else:
            route.fulfill(status=204 if name == "favicon.ico" else 404)

    page.route("**/*", answer)
    page.goto("http://localhost/")
    yield page
    page.close()
    assert trouble == []
