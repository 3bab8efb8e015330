"""The pages for people: the live view at / and the API's documentation at /docs, both without anything from outside."""

from __future__ import annotations

from importlib.metadata import version
from mimetypes import guess_type
from pathlib import Path

from fastapi import FastAPI, Request, Response
from plotly.offline import get_plotlyjs

from service.web.server.assets import Asset

_STATIC = Path(__file__).parent / "static"
_YEAR_SECONDS = 365 * 86400


def install(app: FastAPI) -> None:
    """Add the pages and what they load to `app`."""
    _add(app, "/", Asset(_live_page, "text/html"))
    script = Asset(lambda: get_plotlyjs().encode(), "text/javascript")

    async def plotly(request: Request) -> Response:
        # The page asks with the version in the address, so what it got stays right for good.
        answer = await script.answer(request)
        known = request.query_params.get("v") == version("plotly")
        answer.headers["Cache-Control"] = f"max-age={_YEAR_SECONDS}, immutable" if known else "no-cache"
        return answer

    app.add_route("/static/plotly.min.js", plotly, include_in_schema=False)
    install_documentation(app)


def install_documentation(app: FastAPI) -> None:
    """Add the page at /docs and what it loads to `app`."""
    _add(app, "/docs", _file(_STATIC / "docs.html"))
    for path in sorted(path for path in _STATIC.rglob("*") if path.is_file()):
        _add(app, f"/static/{path.relative_to(_STATIC).as_posix()}", _file(path))


def _live_page() -> bytes:
    page = (_STATIC / "index.html").read_text(encoding="utf-8")
    return page.replace("{plotly}", version("plotly")).encode()


def _file(path: Path) -> Asset:
    return Asset(path.read_bytes, guess_type(path.name)[0] or "application/octet-stream")


def _add(app: FastAPI, path: str, asset: Asset) -> None:
    app.add_route(path, asset.answer, include_in_schema=False)
