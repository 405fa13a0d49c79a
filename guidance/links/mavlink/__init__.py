"""MAVLink: frames, messages, signatures and requests, and the links to vehicles and ground stations by it."""
