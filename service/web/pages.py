"""The pages for people: the live view at / and the API's documentation at /docs, both without anything from outside."""

from __future__ import annotations

from functools import cache
from importlib.metadata import version
from pathlib import Path

from fastapi import FastAPI, Response
from fastapi.responses import FileResponse, HTMLResponse
from plotly.offline import get_plotlyjs
from starlette.staticfiles import StaticFiles

_STATIC = Path(__file__).parent / "static"
_YEAR_SECONDS = 365 * 86400


def install(app: FastAPI) -> None:
    """Add the pages and what they load to `app`."""

    @app.get("/", include_in_schema=False)
    async def live() -> HTMLResponse:
        return HTMLResponse(_live_page())

    @app.get("/static/plotly.min.js", include_in_schema=False)
    def plotly(v: str = "") -> Response:
        # The page asks with the version in the address, so what it got stays right for good.
        kept = f"max-age={_YEAR_SECONDS}, immutable" if v == version("plotly") else "no-cache"
        return Response(_plotly_script(), media_type="text/javascript", headers={"Cache-Control": kept})

    install_documentation(app)


def install_documentation(app: FastAPI) -> None:
    """Add the page at /docs and what it loads to `app`."""

    @app.get("/docs", include_in_schema=False)
    async def documentation() -> FileResponse:
        return FileResponse(_STATIC / "docs.html")

    app.mount("/static", StaticFiles(directory=_STATIC), name="static")


@cache
def _live_page() -> str:
    return (_STATIC / "index.html").read_text(encoding="utf-8").replace("{plotly}", version("plotly"))


@cache
def _plotly_script() -> bytes:
    return get_plotlyjs().encode()
