"""Sources of an evader's reports: their kinds, and the sources by MAVLink and by Zenoh."""
