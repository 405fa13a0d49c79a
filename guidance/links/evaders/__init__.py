"""Where an evader's reports come from: the kinds of sources, and those by MAVLink and by Zenoh."""
