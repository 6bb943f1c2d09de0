"""Memory of finished arrays stays with the process."""

import platform
import subprocess
import sys

import pytest

SCRIPT = """
import resource, sys
if sys.argv[1] == "kept":
    from quadid_logs.cli.memory import keep_freed_memory
    keep_freed_memory()

def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

bytearray(b"x") * (1 << 24)
before = faults()
bytearray(b"x") * (1 << 24)
print(faults() - before)
"""


def page_faults(choice: str) -> int:
    done = subprocess.run([sys.executable, "-c", SCRIPT, choice], capture_output=True, text=True, check=True)
    return int(done.stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc has the setting")
def test_memory_that_was_used_once_costs_no_page_faults_again() -> None:
    """16 MB are 4096 pages; without the setting they are asked for again."""
    assert page_faults("kept") < 400 < page_faults("default")
