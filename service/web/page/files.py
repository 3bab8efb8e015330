"""The pages for people: the live view at / and the API's documentation at /docs, both without anything from outside."""

import gzip
import threading
from functools import cache
from importlib.metadata import version
from pathlib import Path

from fastapi import FastAPI, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse, HTMLResponse
from fastapi.staticfiles import StaticFiles

_STATIC = Path(__file__).parents[1] / "static"
_YEAR_SECONDS = 365 * 86400
_PACKING = threading.Lock()


def install(app: FastAPI) -> None:
    """Add the pages and what they load to `app`."""
    page = (_STATIC / "index.html").read_text(encoding="utf-8").replace("{plotly}", version("plotly"))
    scripts = StaticFiles(packages=[("plotly", "package_data")])

    async def plotly(request: Request) -> Response:
        answer = await scripts.get_response("plotly.min.js", request.scope)
        if isinstance(answer, FileResponse):
            answer = await run_in_threadpool(_from_memory, answer, request)
        # The page asks with the version in the address, so what it got stays right for good.
        known = request.query_params.get("v") == version("plotly")
        answer.headers["Cache-Control"] = f"max-age={_YEAR_SECONDS}, immutable" if known else "no-cache"
        return answer

    app.add_route("/", lambda request: HTMLResponse(page), include_in_schema=False)
    app.add_route("/static/plotly.min.js", plotly, include_in_schema=False)
    install_documentation(app)


def _from_memory(file: FileResponse, request: Request) -> Response:
    """The content of `file`, which all clients share: each would take half a megabyte to read and pack it."""
    # In turn, for as many threads as there are clients would read and pack it the first time.
    with _PACKING:
        plain, packed = _contents(Path(file.path))
    headers = {name: file.headers[name] for name in ("content-type", "etag", "last-modified")}
    if "gzip" not in request.headers.get("accept-encoding", ""):
        return Response(plain, headers=headers)
    return Response(packed, headers=headers | {"content-encoding": "gzip", "vary": "Accept-Encoding"})


@cache
def _contents(path: Path) -> tuple[bytes, bytes]:
    """The content of a file, and the same packed."""
    content = path.read_bytes()
    return content, gzip.compress(content, 5, mtime=0)


def install_documentation(app: FastAPI) -> None:
    """Add the page at /docs and what it loads to `app`."""
    files = StaticFiles(directory=_STATIC)

    async def static(request: Request) -> Response:
        return await files.get_response(request.path_params["path"], request.scope)

    app.add_route("/docs", lambda request: FileResponse(_STATIC / "docs.html"), include_in_schema=False)
    app.add_route("/static/{path:path}", static, include_in_schema=False)
