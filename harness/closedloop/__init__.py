"""Driving by belief: episodes of SUMO's traffic in which the ego's driver acts on what a tracker tells it.

Read ``plan.py``, ``handover.py``, ``episode.py`` and ``worker.py``, in this order.
"""
