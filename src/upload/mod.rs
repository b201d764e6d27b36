//! The laptop's client: brings an acquisition folder to a service, again and again until it is there.
