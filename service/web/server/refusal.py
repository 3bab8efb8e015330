"""An answer that is a problem and nothing else: application/problem+json (RFC 9457)."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from http import HTTPStatus
from typing import TypeVar

from starlette.responses import Response

from service.errors import ServiceError

MEDIA_TYPE = "application/problem+json"

MOST_SENTENCES = 20
"""Mistakes that one answer tells; how many more there are is told too."""

LONGEST_SENTENCE = 500

Mistake = TypeVar("Mistake")


class RequestRefused(ServiceError):
    """A request that gets no answer but a problem: `status`, sentences, headers, and members of the document."""

    def __init__(
        self,
        status: int,
        sentences: Sequence[str],
        retry_after: int | None = None,
        headers: Mapping[str, str] | None = None,
        **members: object,
    ) -> None:
        super().__init__("; ".join(sentences))
        self.status = status
        self.headers = dict(headers or {}) | ({} if retry_after is None else {"Retry-After": str(retry_after)})
        self.members = members


def few(mistakes: Sequence[Mistake], tell: Callable[[Mistake], str]) -> list[str]:
    """One sentence for each of `mistakes`, as far as an answer tells them: MOST_SENTENCES, of LONGEST_SENTENCE
    characters at most."""
    told = [_cut(tell(mistake)) for mistake in mistakes[:MOST_SENTENCES]]
    left = len(mistakes) - len(told)
    return [*told, f"and {left} more"] if left else told


def _cut(sentence: str) -> str:
    return sentence if len(sentence) <= LONGEST_SENTENCE else f"{sentence[: LONGEST_SENTENCE - 3]}..."


def problem_answer(status: int, detail: str, headers: Mapping[str, str] | None = None, **members: object) -> Response:
    """The answer with a problem document and headers."""
    return Response(problem(status, detail, **members), status, dict(headers or {}), MEDIA_TYPE)


def problem(status: int, detail: str, **members: object) -> bytes:
    """A problem document: its status, what is wrong and what to do, and further members."""
    title = HTTPStatus(status).phrase
    return json.dumps(
        {"type": "about:blank", "title": title, "status": int(status), "detail": detail} | members
    ).encode()


def failure_answer() -> Response:
    """The answer to a request that the daemon failed at: the client learns nothing of the inside, the log does."""
    sentence = "the daemon failed to answer this request; its log says why"
    return problem_answer(HTTPStatus.INTERNAL_SERVER_ERROR, sentence)


def refusal(error: RequestRefused) -> Response:
    """The answer to a request that is refused."""
    return problem_answer(error.status, str(error), error.headers, **error.members)
