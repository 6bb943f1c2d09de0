"""A page on one's own machine to drop logs on: ``quadid-log serve``.

::

    browser -> security -> app -> upload -> store (logs, queue, results) -> schedule -> worker
                            ^---------- events <---------- progress <---------------------'

The server never reads a log itself: a process with limits of time and memory
does, as in the fleet. Needs ``quadid-logs[serve]``.
"""
