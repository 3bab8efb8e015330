"""The pages for people: the live view at / and the API's documentation at /docs, both without anything from outside."""

from __future__ import annotations

from pathlib import Path

from fastapi import FastAPI, Response
from fastapi.responses import FileResponse
from plotly.offline import get_plotlyjs
from starlette.staticfiles import StaticFiles

_STATIC = Path(__file__).parent / "static"
_DAY_SECONDS = 86400


def install(app: FastAPI) -> None:
    """Add the pages and what they load to `app`."""

    @app.get("/", include_in_schema=False)
    async def live() -> FileResponse:
        return FileResponse(_STATIC / "index.html")

    @app.get("/static/plotly.min.js", include_in_schema=False)
    def plotly() -> Response:
        headers = {"Cache-Control": f"max-age={_DAY_SECONDS}"}
        return Response(get_plotlyjs(), media_type="text/javascript", headers=headers)

    install_documentation(app)


def install_documentation(app: FastAPI) -> None:
    """Add the page at /docs and what it loads to `app`."""

    @app.get("/docs", include_in_schema=False)
    async def documentation() -> FileResponse:
        return FileResponse(_STATIC / "docs.html")

    app.mount("/static", StaticFiles(directory=_STATIC), name="static")
