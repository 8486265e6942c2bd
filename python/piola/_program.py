"""The command line, as `pip install` brings it."""

import signal
import sys

from . import _piola


def main() -> None:
    # Signals are the program's own business, as without Python around it.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_piola.main(sys.argv[1:]))
