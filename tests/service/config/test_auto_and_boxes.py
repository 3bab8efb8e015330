"""`network = "auto"`, which follows from the channels, and bounds that follow from the floor area."""

from pathlib import Path
from typing import Any

from support.config_samples import SUN, changed
from support.tables import tabled

from estimator.network.boxes import PER_AREA
from service.config.fitting import fingerprint, make_worker
from service.config.load import load
from service.config.site import ZoneConfig

NEIGHBOUR = {"source": "log", "column": "Bedroom", "unit": "degC"}


def living(folder: Path, network: object = "auto", channels: dict[str, Any] | None = None, **keys: Any) -> ZoneConfig:
    """The living room with `network`, more `channels` and other `keys`, loaded."""
    return load(changed(folder, channels=channels, network=network, **keys)).zones[0]


def test_auto_follows_from_the_channels(tmp_path: Path) -> None:
    plain = living(tmp_path).network
    assert (plain.name, plain.channels) == ("auto", ("T_i", "T_out", "u_heat"))
    sunny = living(tmp_path, channels={"I_sol": SUN}).network
    assert sunny.channels == ("T_i", "T_out", "u_heat", "I_sol")
    assert sunny.parameter("A_w").upper == PER_AREA["A_w"][1] * 2000
    both = living(tmp_path, channels={"T_adj_north": NEIGHBOUR, "T_adj": NEIGHBOUR, "I_sol": SUN}).network
    assert both.boundaries == ("T_out", "T_adj", "T_adj_north")
    assert {"g_i_adj", "g_i_adj_north", "A_w"} < {parameter.name for parameter in both.free}


def test_the_fingerprint_of_auto_does_not_depend_on_the_order_of_channels(tmp_path: Path) -> None:
    more = {"T_adj_north": NEIGHBOUR, "I_sol": SUN, "T_adj": NEIGHBOUR}
    ways = [living(tmp_path, channels=dict(order)) for order in (more.items(), reversed(more.items()))]
    assert fingerprint(ways[0]) == fingerprint(ways[1])
    assert fingerprint(ways[0]) != fingerprint(living(tmp_path))


def test_the_state_of_a_preset_of_today_still_belongs_to_it(tmp_path: Path) -> None:
    assert fingerprint(living(tmp_path, "titethria", estimator="rbpf"))[:6] == "cd9f56"


def test_a_member_of_a_bank_can_have_a_variant_of_the_network(tmp_path: Path) -> None:
    members = {"own": {"estimator": "ekf"}, "slab": {"estimator": "ekf", "network": "ground"}}
    bank = make_worker(living(tmp_path, estimator="bank", estimator_options={"members": members})).estimator
    assert [member.network.name for member in bank.members] == ["auto", "auto-ground"]


def test_the_sun_can_be_told_more_about(tmp_path: Path) -> None:
    network = living(tmp_path, {"preset": "auto", "solar": {"node": "T_e", "upper": 12.0}}, {"I_sol": SUN}).network
    assert [heat.node for heat in network.heat_inputs if heat.channel == "I_sol"] == ["T_e"]
    assert network.parameter("A_w").upper == 12.0


@tabled
def test_narrower_bounds_are_proposed_where_they_were_left_to_the_data(
    tmp_path: Path, network: object, proposes: bool
) -> None:
    zone = living(tmp_path, network)
    assert zone.proposes_bounds is proposes
    assert make_worker(zone).settings.proposes_bounds is proposes
