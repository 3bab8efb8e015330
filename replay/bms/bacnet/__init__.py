"""The simulated building on BACnet/IP. `server` needs bacpypes3, and is imported where BACnet is asked for."""
