"""What Home Assistant is told so that every zone appears there as a device (MQTT discovery): which of the entities of
`home_assistant.toml` a zone has, and what is filled in."""

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from string import Template
from typing import Any

from adapters.fields.durations import format_duration
from estimator.diagnosis.finding import FOR_EXPERTS
from service.publish.language import LANGUAGES, Catalogue, sayer
from service.publish.sinks import Announcement

SKILL_DAYS = 7
"""The window whose skill is shown: long enough to be steady, short enough to notice a change."""
_ENTITIES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
_WORDS: Mapping[str, str] = _ENTITIES.pop("words")
_NAMED: Catalogue = ("service.publish", "home_assistant-{language}.json")
_ALWAYS = ("status", "trust", "skill")
"""Entities that say something of a zone that vouches for nothing, too."""
_RUNNING = "{{ 'online' if value_json.state == 'running' else 'offline' }}"

_Filled = Mapping[str, object]


def discovery(
    prefix: str,
    site: str,
    topics: str,
    available: str,
    announcement: Announcement,
    page: str | None = None,
    language: str = LANGUAGES[0],
) -> dict[str, bytes]:
    """The configuration topics under `prefix` of the entities of a zone, with their documents. `topics` is what the
    topics of the zone begin with, `available` where "online" and "offline" are told, `page` the address of the page for
    people, and `language` that of the names, but not of the ids."""
    zone, say = announcement.zone, sayer(language, (), _NAMED)
    identity = f"thermogate_{site}_{zone}"
    common = {
        "device": {
            "identifiers": [identity],
            "name": f"Thermogate {zone}",
            "manufacturer": "Thermogate",
            "model": say("thermal model of a zone"),
            "sw_version": version("thermogate"),
            **({} if page is None else {"configuration_url": f"{page.rstrip('/')}/#/zone/{zone}"}),
        },
        "origin": {"name": "Thermogate", "sw_version": version("thermogate")},
        "availability_mode": "all",
    }
    up = [{"topic": available}]
    # A zone that is stalled or failed has no forecast that anybody should act on; its state is known all the same.
    vouching = [*up, {"topic": f"{topics}/status", "value_template": _RUNNING}]
    found = {}
    for kind, filled in _known(announcement):
        for entity in _ENTITIES[kind]:
            settings = _written(entity, filled)
            component, key, topic = (settings.pop(name) for name in ("component", "key", "topic"))
            document = {
                "unique_id": f"{identity}_{key}",
                "state_topic": f"{topics}/{topic}",
                "availability": up if kind in _ALWAYS else vouching,
                **common,
                **settings,
                "name": say(settings["name"]),
            }
            if language != LANGUAGES[0]:
                # As Home Assistant makes the id of an entity from its name. Before 2025.10 it knows the first alone;
                # where it knows both, the second counts.
                slug = re.sub("[^a-z0-9]+", "_", f"thermogate {zone} {settings['name']}".lower()).strip("_")
                document |= {"object_id": slug, "default_entity_id": f"{component}.{slug}"}
            if "json_attributes_template" in settings:
                document["json_attributes_topic"] = f"{topics}/{topic}"
            found[f"{prefix}/{component}/{identity}/{key}/config"] = json.dumps(document).encode()
    return found


def _known(announcement: Announcement) -> Iterator[tuple[str, _Filled]]:
    """The kinds of entities that the zone has, each with what is filled in."""
    update, reports = announcement.update, announcement.reports
    yield "status", {"for_experts": FOR_EXPERTS}
    if update is not None:
        outputs = update.forecast.outputs
        for index, output in enumerate(outputs):
            levels = [interval.level for interval in output.intervals]
            widest = levels.index(max(levels))
            interval = {"widest": widest, "percent": f"{100 * levels[widest]:g} %"}
            yield "output", _about(index, output.output, len(outputs)) | interval
        if update.volatility.blocks:
            yield "volatility", {}
        yield "gate", {}
        if update.disturbance is not None:
            yield "gain", {}
    if reports.ahead is not None:
        for index, one in enumerate(reports.ahead.outputs):
            about = _about(index, one.output, len(reports.ahead.outputs))
            for horizon in one.horizons:
                last = Template(_WORDS["fan"]).substitute(about) if horizon is one.horizons[-1] else ""
                yield "ahead", about | _horizon(horizon.lead) | {"last": last}
        if reports.ahead.heating is not None:
            yield "heating", {}
    for trusted in () if reports.trust is None else reports.trust.horizons:
        yield "trust", _horizon(trusted.lead)
    for verified in () if reports.skill is None else reports.skill.over(SKILL_DAYS):
        yield "skill", _horizon(verified.lead) | {"days": SKILL_DAYS}


def _about(index: int, output: str, count: int) -> dict[str, object]:
    alone = count == 1
    return {
        "index": index,
        "forecast": "forecast" if alone else f"forecast_{output}",
        "of": "" if alone else f" {output}",
    }


def _horizon(lead: int) -> dict[str, object]:
    return {"lead": lead, "duration": format_duration(lead)}


def _written(entity: Mapping[str, Any], filled: _Filled) -> dict[str, Any]:
    words = {name: Template(text).safe_substitute(filled) for name, text in _WORDS.items()}
    return {
        name: Template(value).substitute(words, **filled) if isinstance(value, str) else value
        for name, value in entity.items()
    }
