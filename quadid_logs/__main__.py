"""`python -m quadid_logs`: the command quadid-log, where its script is not on the path."""

from __future__ import annotations

from quadid_logs.cli import run

if __name__ == "__main__":
    run()
