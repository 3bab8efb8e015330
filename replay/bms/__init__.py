"""A building that lives behind a Modbus server and a Zenoh publisher: `thermogate simulate-bms`."""
