"""The configuration that a daemon keeps beside its state."""

import stat

import pytest
from support.config_samples import sound, write

from service.config.kept import FILE, keep_configuration, kept_configuration
from service.config.load import load
from service.config.written import effective_toml
from service.errors import ServiceError


def test_what_is_kept_loads_as_the_same_configuration(tmp_path):
    config = load(write(tmp_path, sound(tmp_path)))
    config.site.state_dir.mkdir(parents=True)
    for _ in range(2):
        keep_configuration(config)
    path = kept_configuration(config.site.state_dir)
    assert effective_toml(load(path)) == effective_toml(config)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert [file.name for file in config.site.state_dir.iterdir()] == [FILE]


def test_a_socket_takes_the_place_of_host_and_port(tmp_path):
    config = load(write(tmp_path, sound(tmp_path) | {"http": {"socket": "http.sock"}}))
    config.site.state_dir.mkdir(parents=True)
    keep_configuration(config)
    assert load(kept_configuration(config.site.state_dir)).http == config.http


def test_a_folder_without_one_is_said(tmp_path):
    with pytest.raises(ServiceError, match=r"there is no configuration\.toml in .*--config"):
        kept_configuration(tmp_path)
