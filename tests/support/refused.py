"""Requests that are refused, as rows of tests/service/web/refused.json: what is asked, and a part of each sentence."""

import json
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI
from support.http_client import problem, request

_ROWS = json.loads((Path(__file__).parents[1] / "service" / "web" / "refused.json").read_text(encoding="utf-8"))


def refusals(group: str) -> pytest.MarkDecorator:
    """Parametrises a test by the rows of a group."""
    return pytest.mark.parametrize("row", _ROWS[group], ids=lambda row: row["ask"][:60])


def assert_refused(app: FastAPI, row: dict[str, Any]) -> None:
    """What `row` asks is refused with its status (422) and one sentence for each of its errors."""
    method, url = row["ask"].split(" ", 1)
    body = {"json": row["body"]} if "body" in row else {}
    document = problem(request(app, method, url, **body), row.get("status", 422))
    found = document.get("errors") or [document["detail"]]
    assert len(found) == len(row["errors"]), found
    assert [sentence for sentence, told in zip(row["errors"], found, strict=True) if sentence not in told] == [], found
