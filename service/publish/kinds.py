"""The sinks that a configuration can open; a new one is its file in this room and its entry here."""

from service.publish import influxdb, mqtt, zenoh
from service.publish.sinks import SinkKind

SINK_KINDS: dict[str, SinkKind] = {kind.name: kind for kind in (zenoh.KIND, mqtt.KIND, influxdb.KIND)}
