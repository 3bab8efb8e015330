"""The running daemon: start, reload and stop, feeding, watching over itself."""
