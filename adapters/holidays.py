"""Public holidays of countries and their parts."""

import importlib
from collections.abc import Container
from functools import lru_cache


@lru_cache(maxsize=16)
def public_holidays(country: str) -> Container[object]:
    """The public holidays, as dates, of a country such as "DE", or "DE-BW"; ValueError for an unknown one."""
    try:
        package = importlib.import_module("holidays")
    except ImportError:
        raise ValueError(
            "needs the package holidays, which has the public holidays of most countries; install it with "
            "pip install 'thermogate[holidays]', or remove country: weekends are known without it"
        ) from None
    code, _, part = country.partition("-")
    try:
        found: Container[object] = package.country_holidays(code, subdiv=part or None)
    except (NotImplementedError, TypeError):
        raise ValueError(f'"{country}" is not a country that it knows; use a code such as "DE", or "DE-BW"') from None
    return found
