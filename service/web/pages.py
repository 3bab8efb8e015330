"""The pages for people: the live view at / and the API's documentation at /docs, both without anything from outside."""

from __future__ import annotations

from mimetypes import guess_type
from pathlib import Path

from fastapi import FastAPI
from plotly.offline import get_plotlyjs

from service.web.server.assets import Asset

_STATIC = Path(__file__).parent / "static"
_DAY_SECONDS = 86400


def install(app: FastAPI) -> None:
    """Add the pages and what they load to `app`."""
    _add(app, "/", _file(_STATIC / "index.html"))
    headers = {"Cache-Control": f"max-age={_DAY_SECONDS}"}
    _add(app, "/static/plotly.min.js", Asset(lambda: get_plotlyjs().encode(), "text/javascript", headers))
    install_documentation(app)


def install_documentation(app: FastAPI) -> None:
    """Add the page at /docs and what it loads to `app`."""
    _add(app, "/docs", _file(_STATIC / "docs.html"))
    for path in sorted(path for path in _STATIC.rglob("*") if path.is_file()):
        _add(app, f"/static/{path.relative_to(_STATIC).as_posix()}", _file(path))


def _file(path: Path) -> Asset:
    return Asset(path.read_bytes, guess_type(path.name)[0] or "application/octet-stream")


def _add(app: FastAPI, path: str, asset: Asset) -> None:
    app.add_route(path, asset.answer, include_in_schema=False)
