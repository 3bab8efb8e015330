from adapters.mqtt.fields import *  # noqa: F403
