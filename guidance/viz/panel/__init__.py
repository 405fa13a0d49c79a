"""The panel: shows daemons in a browser and sends them orders. A separate process; needs the extra `panel`.

Contents:
    server: serves the page. access: who may connect. hub: finds daemons, sends orders, and has the data of all daemons.
    snapshot: the page's data of a flight, live or recorded. records: finished flights.
"""
