"""From a configuration file to a checked site, whose zones carry their network and options."""
