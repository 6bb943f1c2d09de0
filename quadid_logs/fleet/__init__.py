"""Many logs of many vehicles: analyze them on one machine or many, and see how each vehicle ages.

::

    log_files  ->  work (in processes of the workers)  ->  store  ->  history  ->  changes  ->  page
                     ^ engine hands them out                  sql asks anything else

Needs ``quadid-logs[fleet]``; nothing else of the package does.
"""
