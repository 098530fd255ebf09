"""Closed-loop driving: episodes in which the ego's driver acts on what a tracker reports.

Read ``plan.py``, ``episode_start.py``, ``episode.py`` and ``worker.py``, in this order.
"""
