"""The kinds of source there are: one line for each."""

from adapters.bacnet.config import BacnetConfig
from adapters.channel import SourceConfig
from adapters.csv.config import CsvConfig
from adapters.home_assistant.config import HomeAssistantConfig
from adapters.http.config import HttpSourceConfig
from adapters.modbus.config import ModbusConfig
from adapters.mqtt.config import MqttSourceConfig
from adapters.opcua.config import OpcuaConfig, OpcuaHistoryConfig
from adapters.schedule.config import ScheduleConfig
from adapters.series.config import InfluxConfig, PrometheusConfig
from adapters.zenoh.config import ZenohSourceConfig

SOURCE_KINDS: dict[str, type[SourceConfig]] = {
    table.model_fields["kind"].default: table
    for table in (
        BacnetConfig,
        CsvConfig,
        HomeAssistantConfig,
        HttpSourceConfig,
        InfluxConfig,
        ModbusConfig,
        MqttSourceConfig,
        OpcuaConfig,
        OpcuaHistoryConfig,
        PrometheusConfig,
        ScheduleConfig,
        ZenohSourceConfig,
    )
}
