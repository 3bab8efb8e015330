"""What Home Assistant is told so that every zone appears there as a device: MQTT discovery. Pure."""

from __future__ import annotations

import json
from collections.abc import Iterator
from importlib.metadata import version
from typing import Any

from adapters.fields.durations import format_duration
from service.publish.payloads import AheadPayload
from service.publish.sinks import Announcement
from service.records.skill import Skill
from service.records.status import STATES
from service.records.trust import LEVELS, Trust
from service.records.update import CONSTANT, Update

SKILL_DAYS = 7
"""The window whose skill is shown: long enough to be steady, short enough to notice a change."""

_NUMBER = {"state_class": "measurement", "suggested_display_precision": 2}
_TEMPERATURE = {"device_class": "temperature", "unit_of_measurement": "°C"} | _NUMBER
_REGIMES = ("low", "transitional", "high", CONSTANT)
_RUNNING = "{{ 'online' if value_json.state == 'running' else 'offline' }}"
_SENTENCES = (
    "(([value_json.reason] if value_json.state in ('stalled', 'failed') else [])"
    " + (value_json.findings | map(attribute='sentence') | list))"
)
_PROBLEM = f"{{{{ 'ON' if {_SENTENCES} else 'OFF' }}}}"
_SENTENCE = f"{{{{ {{'sentence': {_SENTENCES} | first | default(''), 'all': {_SENTENCES}}} | tojson }}}}"
_REASON = "{{ {'state': value_json.state, 'reason': value_json.reason} | tojson }}"
_FORECAST = (
    "{{ {'issue_time': value_json.issue_time, 'valid_time': value_json.valid_time, 'quality': value_json.quality, "
    "'sd': value_json.sd} | tojson }}"
)


def discovery(
    prefix: str, site: str, topics: str, available: str, announcement: Announcement, page: str | None = None
) -> dict[str, bytes]:
    """The configuration topics under `prefix` of the entities of a zone, with their documents.

    `topics` is what the topics of the zone begin with, `available` where "online" and "offline" are told, and
    `page` the address of the page for people.
    """
    zone, update = announcement.zone, announcement.update
    identity = f"thermogate_{site}_{zone}"
    common = {
        "device": {
            "identifiers": [identity],
            "name": f"Thermogate {zone}",
            "manufacturer": "Thermogate",
            "model": "thermal model of a zone",
            "sw_version": version("thermogate"),
            **({} if page is None else {"configuration_url": f"{page.rstrip('/')}/#/zone/{zone}"}),
        },
        "origin": {"name": "Thermogate", "sw_version": version("thermogate")},
        "availability_mode": "all",
    }
    up = [{"topic": available}]
    # A zone that is stalled or failed has no forecast that anybody should act on; its state is known all the same.
    vouching = [*up, {"topic": f"{topics}/status", "value_template": _RUNNING}]
    entities = [*((up, entity) for entity in _of_status())]
    if update is not None:
        entities += [(vouching, entity) for entity in _of_update(update)]
    reports = announcement.reports
    if reports.ahead is not None:
        entities += [(vouching, entity) for entity in _of_hours_ahead(reports.ahead)]
    if reports.trust is not None:
        entities += [(up, entity) for entity in _of_trust(reports.trust)]
    if reports.skill is not None:
        entities += [(up, entity) for entity in _of_skill(reports.skill)]
    found = {}
    for availability, (component, key, topic, settings) in entities:
        document = {
            "unique_id": f"{identity}_{key}",
            "state_topic": f"{topics}/{topic}",
            "availability": availability,
            **common,
            **settings,
        }
        if "json_attributes_template" in settings:
            document["json_attributes_topic"] = f"{topics}/{topic}"
        found[f"{prefix}/{component}/{identity}/{key}/config"] = json.dumps(document).encode()
    return found


_Entity = tuple[str, str, str, dict[str, Any]]
"""Component, key, the topic that its value comes from, and what else is to be said of it."""


def _of_status() -> Iterator[_Entity]:
    diagnostic = {"entity_category": "diagnostic"}
    state = {
        "name": "State",
        "device_class": "enum",
        "options": list(STATES),
        "value_template": "{{ value_json.state }}",
    }
    yield "sensor", "state", "status", state | {"json_attributes_template": _REASON} | diagnostic
    last = {"device_class": "timestamp", "value_template": "{{ value_json.last_sample_time }}"}
    yield "sensor", "last_sample", "status", {"name": "Last sample"} | last | diagnostic
    problem = {"name": "Problem", "device_class": "problem", "value_template": _PROBLEM}
    yield "binary_sensor", "problem", "status", problem | {"json_attributes_template": _SENTENCE}


def _of_update(update: Update) -> Iterator[_Entity]:
    outputs = update.forecast.outputs
    for index, output in enumerate(outputs):
        of = "" if len(outputs) == 1 else f" {output.output}"
        key = "forecast" if len(outputs) == 1 else f"forecast_{output.output}"
        place = f"value_json.outputs[{index}]"
        mean = {"name": f"Forecast{of}", "value_template": f"{{{{ {place}.mean }}}}"}
        yield "sensor", key, "forecast", mean | _TEMPERATURE | {"json_attributes_template": _FORECAST}
        widest = max(range(len(output.intervals)), key=lambda k: output.intervals[k].level)
        percent = f"{100 * output.intervals[widest].level:g} %"
        for bound in ("lower", "upper"):
            settings = {
                "name": f"Forecast{of} {bound} ({percent})",
                "value_template": f"{{{{ {place}.intervals[{widest}].{bound} }}}}",
            }
            yield "sensor", f"{key}_{bound}", "forecast", settings | _TEMPERATURE
    if update.volatility.blocks:
        alpha = {"name": "Volatility", "value_template": "{{ value_json.volatility.median }}"}
        yield "sensor", "volatility", "volatility", alpha | _NUMBER
    yield "sensor", "gate", "gate", {"name": "Learning gate", "value_template": "{{ value_json.gate }}"} | _NUMBER
    regime = {
        "name": "Regime",
        "device_class": "enum",
        "options": list(_REGIMES),
        "value_template": "{{ value_json.regime }}",
    }
    yield "sensor", "regime", "gate", regime
    if update.disturbance is not None:
        gain = {
            "name": "Unmeasured heat",
            "device_class": "power",
            "unit_of_measurement": "W",
            "value_template": "{{ value_json.median }}",
        }
        yield "sensor", "gain", "gain", gain | _NUMBER | {"suggested_display_precision": 0}


def _of_hours_ahead(ahead: AheadPayload) -> Iterator[_Entity]:
    for index, output in enumerate(ahead.outputs):
        alone = len(ahead.outputs) == 1
        key, of = ("forecast", "") if alone else (f"forecast_{output.output}", f" {output.output}")
        place = f"value_json.outputs[{index}]"
        for horizon in output.horizons:
            chosen = f"({place}.horizons | selectattr('lead_s', 'eq', {horizon.lead}) | first)"
            told = ", ".join(f"'{name}': {chosen}.{name}" for name in ("valid_time", "lower", "upper", "sd"))
            told += ", 'quality': value_json.quality"
            if horizon is output.horizons[-1]:
                columns = (f"'{name}': {place}.{name} | map('round', 2) | list" for name in ("mean", "lower", "upper"))
                begin = "'start': value_json.valid_time, 'step_s': value_json.step_s"
                told += f", 'fan': {{{begin}, {', '.join(columns)}}}"
            settings = {
                "name": f"Forecast{of} {format_duration(horizon.lead)} ahead",
                "value_template": f"{{{{ {chosen}.mean }}}}",
                "json_attributes_template": f"{{{{ {{{told}}} | tojson }}}}",
            }
            yield "sensor", f"{key}_{horizon.lead}", "ahead", _TEMPERATURE | settings
    if ahead.heating is not None:
        told = ", ".join(f"'{name}': value_json.heating.{name}" for name in ("target", "by", "probability", "reached"))
        start = {
            "name": "Start heating",
            "device_class": "timestamp",
            "value_template": "{{ value_json.heating.start if value_json.heating else None }}",
            "json_attributes_template": f"{{{{ ({{{told}}} if value_json.heating else {{}}) | tojson }}}}",
        }
        yield "sensor", "start_heating", "ahead", start


def _of_trust(trust: Trust) -> Iterator[_Entity]:
    for horizon in trust.horizons:
        chosen = f"(value_json.horizons | selectattr('lead_s', 'eq', {horizon.lead}) | first)"
        told = ", ".join(f"'{name}': {chosen}.{name}" for name in ("reason", "since", "planned"))
        settings = {
            "name": f"Trust {format_duration(horizon.lead)} ahead",
            "device_class": "enum",
            "options": list(LEVELS),
            "value_template": f"{{{{ {chosen}.trust }}}}",
            "json_attributes_template": f"{{{{ {{{told}}} | tojson }}}}",
        }
        yield "sensor", f"trust_{horizon.lead}", "trust", settings


def _of_skill(skill: Skill) -> Iterator[_Entity]:
    for horizon in skill.over(SKILL_DAYS):
        ahead = format_duration(horizon.lead)
        chosen = (
            f"((value_json.windows | selectattr('days', 'eq', {SKILL_DAYS}) | first).horizons"
            f" | selectattr('lead_s', 'eq', {horizon.lead}) | first)"
        )
        shown = _NUMBER | {"entity_category": "diagnostic"}
        against = {"name": f"Skill {ahead} ahead", "value_template": f"{{{{ {chosen}.skill_against_persistence }}}}"}
        yield "sensor", f"skill_{horizon.lead}", "skill", against | shown
        # K of a difference: with a device class it would be converted to degC as a temperature is.
        error = {"name": f"Error {ahead} ahead", "value_template": f"{{{{ {chosen}.rmse }}}}"}
        yield "sensor", f"rmse_{horizon.lead}", "skill", error | shown | {"unit_of_measurement": "K"}
