"""Closed-form pursuit guidance for real autopilots (Li, Wang & Xie, arXiv 2202.13522)."""
