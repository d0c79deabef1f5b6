"""Episodes and rules in, results out: in one process, in a pool of them, or on a Ray cluster.

Every engine calls the same pure function, ``score_episode``; it adds that whatever happens to a process
costs no more than the episode that was in it.
"""
