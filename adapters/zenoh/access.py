"""Who may do what on a Zenoh session, as its `access_control`: all that is not allowed here is denied.

Every message that comes in or goes out is looked at, by its key and by who is at the other end of the connection. Zenoh
knows them by the name of their user and by the common name of their certificate.
"""

from __future__ import annotations

from collections.abc import Sequence

ANYBODY = "*"
"""Stands among names for everyone who can connect."""

_ASK = ("declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query")
_TELL = ("put", "delete", "reply", "declare_queryable", "liveliness_token")
_EVERY_KEY = ("**", "**/@adv/**")
"""Names that begin with @ are found by no wildcard; advanced publishers keep their caches there."""


def publishing(key: str) -> dict[str, object]:
    """Everyone may ask, and we alone tell, on `key` and nothing else."""
    return _access_control(
        [("ask", _ASK, "ingress", _EVERY_KEY), ("tell", _TELL, "egress", (key,))], {"all": ("ask", "tell")}, ()
    )


def collecting(writers: Sequence[str], relaying: bool) -> dict[str, object]:
    """We ask, and only `writers`, names or ANYBODY, may tell; if `relaying`, others may ask too and are told."""
    rules = [("ask", _ASK, "egress", _EVERY_KEY), ("tell", _TELL, "ingress", _EVERY_KEY)]
    everyone: tuple[str, ...] = ("ask",)
    if relaying:
        rules += [("be-asked", _ASK, "ingress", _EVERY_KEY), ("relay", _TELL, "egress", _EVERY_KEY)]
        everyone += ("be-asked", "relay")
    if ANYBODY in writers:
        return _access_control(rules, {"all": (*everyone, "tell")}, ())
    return _access_control(rules, {"all": everyone, "named": ("tell",)}, writers)


def _access_control(
    rules: Sequence[tuple[str, Sequence[str], str, Sequence[str]]],
    policies: dict[str, tuple[str, ...]],
    names: Sequence[str],
) -> dict[str, object]:
    """`rules` as (id, messages, flow, keys); `policies` name the rules of "all" and of the "named" ones."""
    # What a subject does not say fits everyone; one that says both user and certificate would want both.
    subjects: dict[str, list[dict[str, object]]] = {
        "all": [{"id": "all"}],
        "named": [
            {"id": "user", "usernames": list(names)},
            {"id": "certificate", "cert_common_names": list(names)},
        ],
    }
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [
            {"id": id, "messages": list(messages), "flows": [flow], "permission": "allow", "key_exprs": list(keys)}
            for id, messages, flow, keys in rules
        ],
        "subjects": [subject for group in policies for subject in subjects[group]],
        "policies": [
            {"rules": list(allowed), "subjects": [subject["id"] for subject in subjects[group]]}
            for group, allowed in policies.items()
        ],
    }
