"""The discovery of Home Assistant in another language: names are translated, ids are not."""

import json
import tomllib
from pathlib import Path
from string import Template
from typing import Any

import pytest
from support.fake_zones import make_update, running

import service.publish
from service.publish.home_assistant import discovery
from service.publish.language import sayer
from service.publish.sinks import Announcement, Occasion, Reports

ENTITIES = tomllib.loads((Path(service.publish.__path__[0]) / "home_assistant.toml").read_text(encoding="utf-8"))
ALIKE = ("Problem", "Regime")
"""Names that are the same in German."""


@pytest.mark.parametrize("of", ["", " T_i"])
def test_every_entity_has_a_german_name(of: str) -> None:
    german = sayer("de", (), ("service.publish", "home_assistant-{language}.json"))
    filled = {"of": of, "percent": "95 %", "duration": "6h"}
    names = [
        Template(entity["name"]).substitute(filled)
        for kind, entities in ENTITIES.items()
        if kind != "words"
        for entity in entities
    ]
    assert [name for name in names if german(name) == name and name not in ALIKE] == []


def found(language: str) -> dict[str, Any]:
    zone = running("living")
    state = zone.now()._replace(update=make_update(2))
    told = Announcement("htwg", "living", state, Occasion.UPDATE, Reports(zone.skill(), trust=state.trust))
    documents = discovery("ha", "htwg", "thermogate/htwg/living", "available", told, language=language)
    return {topic: json.loads(document) for topic, document in documents.items()}


def test_a_german_entity_has_the_ids_of_an_english_one() -> None:
    english, german = found("en"), found("de")
    assert english.keys() == german.keys()
    for topic, entity in german.items():
        assert entity["unique_id"] == english[topic]["unique_id"]
        assert entity["device"]["identifiers"] == english[topic]["device"]["identifiers"]
        assert not {"object_id", "default_entity_id"} & english[topic].keys(), "the name says it"
    lower = german["ha/sensor/thermogate_htwg_living/forecast_lower/config"]
    assert lower["name"] == "Vorhersage, untere Grenze (95 %)"
    # What docs/home-assistant.md names.
    assert lower["default_entity_id"] == f"sensor.{lower['object_id']}" == "sensor.thermogate_living_forecast_lower_95"
    assert (
        german["ha/sensor/thermogate_htwg_living/state/config"]["device"]["model"] == "thermisches Modell eines Raums"
    )
