"""BACnet's engineering units (ASHRAE 135, clause 21) in the words of the configuration."""

NO_UNITS = 95

_OURS = {
    62: "degC",
    63: "K",
    64: "degF",
    47: "W",
    48: "kW",
    49: "MW",
    50: "BTU/h",
    35: "W/m2",
    98: "%",
    NO_UNITS: "1",
    16: "J",
    126: "MJ",
    18: "Wh",
    19: "kWh",
    146: "MWh",
}


def unit_of(number: int) -> str | None:
    """The unit that a device states by `number`, as a channel writes it; None for one that no channel can have."""
    return _OURS.get(number)


def differs(stated: int | None, unit: str) -> bool:
    """Whether a device that states `stated` means another unit than `unit`; one that states none does not."""
    return stated is not None and stated != NO_UNITS and unit_of(stated) != unit
