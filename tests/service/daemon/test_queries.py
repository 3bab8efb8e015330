"""Questions on Zenoh, asked by a second session on loopback: the answers of REST."""

import asyncio
import json
import threading
from typing import Any

import pytest
from anyio.from_thread import start_blocking_portal
from support.http_client import get, post
from support.processes import free_port
from support.publishing import opened, settings
from support.site_of_rooms import Room, site_of
from support.tables import tabled
from support.zenoh_plant import session as session_of

from service.daemon.queries import Queries
from service.publish.zenoh import MOST_QUESTIONS, Reply
from service.web.app import create_questions

ROOMS = {"living": Room("ekf"), "cellar": Room("arx"), "new": Room("ekf", samples=0)}
SITE = "thermogate/htwg"


@pytest.fixture(scope="module")
def app(tmp_path_factory):
    """REST, and the routes that answer questions."""
    with site_of(tmp_path_factory.mktemp("site"), ROOMS) as (made, zones):
        yield made, create_questions("htwg", zones)


@pytest.fixture(scope="module")
def loop():
    with start_blocking_portal() as portal:
        yield portal.call(asyncio.get_running_loop)


@pytest.fixture(scope="module")
def publisher_and_session():
    address = f"tcp/127.0.0.1:{free_port()}"
    publisher = opened(settings(listen=(address,)), list(ROOMS))
    with session_of(connect=address) as session:
        yield publisher, session
    publisher.close()


@pytest.fixture
def session(app, loop, publisher_and_session):
    publisher, session = publisher_and_session
    publisher.answer_with(Queries(app[1], loop).answer)
    return session


def ask(session, selector, body=None):
    """Whether each reply is good, and its JSON."""
    payload = None if body is None else json.dumps(body).encode()
    found = []
    for reply in session.get(selector, payload=payload, timeout=120):
        answer = reply.ok if reply.ok is not None else reply.err
        found.append((reply.ok is not None, json.loads(answer.payload.to_bytes())))
    return found


def test_the_fan_and_the_plan_are_those_of_rest(app, session):
    (answer,) = ask(session, f"{SITE}/living/fan?horizon=1h;level=0.5|0.9")
    assert answer == (True, get(app[0], "/zones/living/forecast?horizon=1h&level=0.5&level=0.9").json())
    body = {"horizon": "30min", "inputs": {"u_heat": [0, 500, 500, 500, 0, 0]}}
    (answer,) = ask(session, f"{SITE}/living/plan", body)
    assert answer == (True, post(app[0], "/zones/living/forecast", body).json())


def test_model_parameters_and_forecasts_are_those_of_rest(app, session):
    (answer,) = ask(session, f"{SITE}/living/model?step=15min;draws=5")
    assert answer == (True, get(app[0], "/zones/living/model?step=15min&draws=5").json())
    (answer,) = ask(session, f"{SITE}/living/parameters?level=0.5")
    assert answer == (True, get(app[0], "/zones/living/parameters?level=0.5").json())
    body = {"horizon": "1h", "plans": [{"inputs": {"*": {"u_heat": 0.0}}}]}
    (answer,) = ask(session, f"{SITE}/forecasts", body)
    assert answer == (True, post(app[0], "/forecasts", body).json())


@tabled
def test_what_is_asked_wrongly_is_refused_with_the_sentence_of_rest(session, selector, body, words):
    (answer,) = ask(session, f"{SITE}/{selector}", body)
    assert answer[0] is False
    assert words in answer[1]["detail"]


def test_parameters_of_zenoh_itself_are_not_refused(session):
    assert ask(session, f"{SITE}/living/status?_time=[now(-1h)..]") == [], "nothing was published yet, and no error"


def test_questions_that_wait_are_bounded(publisher_and_session):
    publisher, session = publisher_and_session
    held: list[Any] = []
    full = threading.Event()

    def hold(question, reply):
        held.append(reply)
        if len(held) == MOST_QUESTIONS:
            full.set()

    publisher.answer_with(hold)
    waiting = [session.get(f"{SITE}/living/fan", timeout=120) for _ in range(MOST_QUESTIONS)]
    assert full.wait(120)
    (answer,) = ask(session, f"{SITE}/living/fan")
    assert answer[0] is False
    assert "wait for their answers" in answer[1]["detail"]
    for reply in held:
        reply(Reply(True, b"{}"))
    assert [reply.ok.payload.to_bytes() for replies in waiting for reply in replies] == [b"{}"] * MOST_QUESTIONS
