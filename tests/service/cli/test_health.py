"""`thermogate health` against servers that answer as the daemon does."""

import json
import socket
import threading
from contextlib import ExitStack

import pytest
from support.tables import tabled
from support.web_answers import answering

from service.cli.main import main

ALIVE = (200, {"status": "ok", "version": "1.2.3", "uptime_s": 60.4})


@pytest.fixture
def serve():
    """Serve documents by path; what was asked, with its headers, is noted."""
    with ExitStack() as stack:

        def start(answers):
            asked = []

            def answer(path, authorization):
                asked.append((path, authorization))
                status, document = answers[path]
                return status, document if isinstance(document, bytes) else json.dumps(document).encode()

            return stack.enter_context(answering(answer)), asked

        yield start


def health(capsys, *words):
    code = main(["health", *words])
    (line,) = capsys.readouterr().out.splitlines()
    return code, line


@tabled
def test_what_a_daemon_answers(serve, capsys, alive, ready, words, expected, paths):
    url, asked = serve({"/healthz": alive, "/readyz": ready})
    assert health(capsys, "--url", f"{url}/", *words) == tuple(expected)
    assert asked == [(path, None) for path in paths]


def test_the_key_comes_from_a_file(serve, capsys, tmp_path):
    (tmp_path / "key").write_text("tg_secret\n")
    url, asked = serve({"/healthz": ALIVE, "/readyz": (401, {"detail": "this API key is not valid"})})
    told = health(capsys, "--url", url, "--key-file", str(tmp_path / "key"))
    assert told == (3, "UNKNOWN - this API key is not valid")
    assert asked[-1] == ("/readyz", "Bearer tg_secret")


@pytest.mark.parametrize("option", ["--key-file", "--ca-file"])
@pytest.mark.parametrize("content", [b"tg_secret\nanother line\n", b"tg_s\xffcret", b"", None])
def test_a_file_that_cannot_be_used_is_no_fault_of_the_daemon_and_not_repeated(
    serve, capsys, tmp_path, option, content
):
    file = tmp_path / "given"
    if content is not None:
        file.write_bytes(content)
    url, asked = serve({})
    code, line = health(capsys, "--url", url, option, str(file))
    assert (code, asked) == (3, [])
    assert line.startswith(f"UNKNOWN - {option}: {file} ")
    assert "cret" not in line


def test_what_does_not_answer(capsys):
    code, line = health(capsys, "--url", "http://127.0.0.1:9", "--timeout", "2")
    assert code == 2
    assert line.startswith("CRITICAL - http://127.0.0.1:9 does not answer: ")


ELSE = [(200, []), (200, {}), (404, {}), (503, [1]), (503, {"zones": 3}), (200, b"<html>")]


@pytest.mark.parametrize(("status", "document"), ELSE)
def test_another_server_is_no_daemon(serve, capsys, status, document):
    url, _ = serve({"/healthz": (200, {}), "/readyz": (status, document)})
    said = f"CRITICAL - {url} answers, but not as a daemon of Thermogate does; correct --url"
    assert health(capsys, "--url", url) == (2, said)


@pytest.mark.parametrize("greeting", [b"SSH-2.0-OpenSSH\r\n", b"\x15\x03\x03\x00\x02\x02\x46"])
def test_what_speaks_no_http_is_no_daemon(capsys, greeting):
    with socket.create_server(("127.0.0.1", 0)) as server:

        def greet():
            with server.accept()[0] as client:
                client.recv(4096)
                client.sendall(greeting)

        thread = threading.Thread(target=greet)
        thread.start()
        code, line = health(capsys, "--url", f"http://127.0.0.1:{server.getsockname()[1]}")
        thread.join()
    assert code == 2
    assert line.isprintable()
    assert "not as a daemon" in line


@pytest.mark.parametrize("url", ["http://[::1", "http://127.0.0.1:x", "http://127.0.0.1/a b", "file:///etc/passwd"])
def test_an_address_that_cannot_be_used_says_nothing_of_the_daemon(capsys, url):
    code, line = health(capsys, "--url", url)
    assert code == 3
    assert f"{url} is no URL of a daemon" in line
