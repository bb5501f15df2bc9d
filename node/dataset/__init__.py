"""Degraded copies of data sets: which files there are, one job a file, kind and level, labels.

``sources`` finds the files, ``plan`` makes the jobs and refuses what cannot be done, ``job`` does
one, ``workers`` gives the processes that do them, ``labels`` says in the end what was done.
"""
