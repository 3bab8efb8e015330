"""BACnet/IP, read only: objects, connection, subscriptions, polling. What needs bacpypes3 is imported when it runs."""
