"""The panel: shows daemons in a browser and sends them orders. A separate process; needs the extra `panel`.

Contents:
    server: serves the page. access: who may connect. bus: finds daemons, sends orders. hub: data of all daemons.
    snapshot: what the page shows of a flight. records, playback: finished flights.
"""
