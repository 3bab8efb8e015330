"""Who may do what on a Zenoh session, as its `access_control`: all that is not allowed here is denied.

Every message that comes in or goes out is looked at, by its key and by who is at the other end of the connection. Zenoh
knows them by the name of their user and by the common name of their certificate.
"""

from collections.abc import Sequence

ANYBODY = "*"
"""Stands among names for everyone who can connect."""

_ASK = ("declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query")
_TELL = ("put", "delete", "reply", "declare_queryable", "liveliness_token")
_EVERY_KEY = ("**", "**/@adv/**")
"""Names that begin with @ are found by no wildcard; advanced publishers keep their caches there."""


def publishing(key: str) -> dict[str, object]:
    """Everyone may ask, and we alone tell, on `key` and nothing else."""
    return _access_control([_rule("ask", _ASK, "ingress"), _rule("tell", _TELL, "egress", (key,))], ())


def collecting(writers: Sequence[str], relaying: bool) -> dict[str, object]:
    """We ask, and only `writers`, names or ANYBODY, may tell; if `relaying`, others may ask too and are told."""
    rules = [_rule("ask", _ASK, "egress")]
    if relaying:
        rules += [_rule("be-asked", _ASK, "ingress"), _rule("relay", _TELL, "egress")]
    tell = _rule("tell", _TELL, "ingress")
    if ANYBODY in writers:
        return _access_control([*rules, tell], ())
    return _access_control(rules, writers, [tell])


def _rule(id: str, messages: Sequence[str], flow: str, keys: Sequence[str] = _EVERY_KEY) -> dict[str, object]:
    return {"id": id, "messages": list(messages), "flows": [flow], "permission": "allow", "key_exprs": list(keys)}


def _access_control(
    rules: Sequence[dict[str, object]], names: Sequence[str], of_the_named: Sequence[dict[str, object]] = ()
) -> dict[str, object]:
    """`rules` for everyone, and those `of_the_named` for the users and certificates with `names`."""
    subjects: list[dict[str, object]] = [{"id": "all"}]
    policies = [{"rules": [rule["id"] for rule in rules], "subjects": ["all"]}]
    if of_the_named:
        # What a subject does not say fits everyone; one that says both user and certificate would want both.
        subjects.append({"id": "user", "usernames": list(names)})
        subjects.append({"id": "certificate", "cert_common_names": list(names)})
        policies.append({"rules": [rule["id"] for rule in of_the_named], "subjects": ["user", "certificate"]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [*rules, *of_the_named],
        "subjects": subjects,
        "policies": policies,
    }
