"""MQTT: the connection to a broker, subscriptions, and the source on top."""
