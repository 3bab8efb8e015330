"""What all tests share: the daemon's choice of a kernel cache, made before anything imports Numba."""

from service.daemon.process import prepare_process

prepare_process()
