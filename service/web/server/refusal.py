"""A request that is answered with a problem and nothing else: application/problem+json (RFC 9457)."""

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
CLOSE = {"Connection": "close"}
"""Of an answer after which nothing more of a request is read."""

Mistake = TypeVar("Mistake")


class RequestRefused(ServiceError):
    """A request answered by a problem: `status`, sentences (what is wrong, what to do), headers, members."""

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

    @property
    def answer(self) -> Response:
        """The problem document, with its headers."""
        title = HTTPStatus(self.status).phrase
        document = {"type": "about:blank", "title": title, "status": int(self.status), "detail": str(self)}
        return Response(json.dumps(document | self.members), self.status, self.headers, MEDIA_TYPE)


FAILED = RequestRefused(
    HTTPStatus.INTERNAL_SERVER_ERROR, ["the daemon failed to answer this request; its log says why"]
)
"""What the daemon itself failed at: the client learns nothing of the inside."""


def few(mistakes: Sequence[Mistake], tell: Callable[[Mistake], str]) -> list[str]:
    """Sentences for `mistakes`: MOST_SENTENCES, of LONGEST_SENTENCE characters at most."""
    told = [tell(mistake) for mistake in mistakes[:MOST_SENTENCES]]
    told = [one if len(one) <= LONGEST_SENTENCE else f"{one[: LONGEST_SENTENCE - 3]}..." for one in told]
    left = len(mistakes) - len(told)
    return [*told, f"and {left} more"] if left else told
