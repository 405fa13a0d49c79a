"""PX4 without MAVLink: its own messages over Zenoh, and guidance as one of its flight modes."""
