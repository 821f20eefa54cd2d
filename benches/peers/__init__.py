"""The parts of `compare_peers.py`: clouds, rows, and the peers' own way to a pose."""
