"""Whether the daemon may be reached from where its configuration says: encrypted, and with keys."""

import os
from datetime import UTC, datetime

from service.config.site import Config
from service.errors import CertificateError, ConfigError, KeyFileError
from service.web.keys import read_keys
from service.web.server.tls import server_certificate


def check_exposure(config: Config) -> None:
    """Raise ConfigError, a sentence each, if the certificate cannot be used or others could ask without a key."""
    problems = []
    try:
        server_certificate(config.http)
    except CertificateError as error:
        problems.append(str(error))
    try:
        keys = read_keys(config.keys_file)
    except KeyFileError as error:
        # On loopback an operator may check without being able to see into the state folder; a start will see.
        if config.http.exposed or os.access(config.keys_file, os.R_OK):
            problems.append(f"http.keys_file: {error}")
    else:
        if config.http.exposed and not any(key.state(datetime.now(UTC)) == "active" for key in keys):
            problems.append(
                "http: other machines are let in, and there is no valid API key to tell them apart by; make one with "
                "`thermogate keys create CONFIG NAME --scope read`"
            )
    if problems:
        raise ConfigError(problems)
