"""Driving by belief: episodes of SUMO's traffic in which the ego's driver acts on what a tracker tells it.

Read ``plan.py``, ``episode_start.py``, ``episode.py`` and ``worker.py``, in this order.
"""
