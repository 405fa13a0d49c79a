"""Who we are to a Zenoh router: TLS, mutual TLS, user and password, from a TOML file.

    tls_ca_file = "ca.pem"               # routers whose certificate this authority signed
    tls_certificate_file = "uav1.pem"    # who we are
    tls_key_file = "uav1.key"
    user = "uav1"
    password_file = "uav1.password"      # one line

Names count from the file's folder. What is not given is not shown.
"""

import ssl
import tomllib
from pathlib import Path
from typing import Any, Final

from sitl_mock.errors import ConfigError

_FILES: Final = ("tls_ca_file", "tls_certificate_file", "tls_key_file", "password_file")
_KEYS: Final = (*_FILES, "user")
_NEEDS: Final = {
    "tls_certificate_file": ("tls_key_file", "tls_ca_file"),
    "tls_key_file": ("tls_certificate_file",),
    "user": ("password_file",),
    "password_file": ("user",),
}


def read_keys(path: Path) -> dict[str, Any]:
    """Return Zenoh's `transport` settings: `auth` and `link.tls`, for calling a router.

    Raises:
        ConfigError: The file, or one that it names, is missing or wrong; the message names both and the key.
    """
    given = _table(path)
    for key in _FILES:
        if key in given:
            given[key] = str((path.parent / given[key]).absolute())
            _readable(path, key, given[key])
    settings: dict[str, Any] = {}
    if "user" in given:
        password = Path(given["password_file"]).read_text(encoding="utf-8").rstrip("\n")
        settings["auth"] = {"usrpwd": {"user": given["user"], "password": password}}
    if "tls_ca_file" in given:
        settings["link"] = {"tls": _tls(path, given)}
    return settings


def _table(path: Path) -> dict[str, Any]:
    try:
        given = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"--zenoh-keys {path}: cannot be read ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"--zenoh-keys {path}: is no TOML: {error}") from None
    for key, value in given.items():
        if key not in _KEYS or not isinstance(value, str):
            raise ConfigError(f"{path}: {key} = {value!r}: allowed are {', '.join(_KEYS)}, each a text")
        missing = [other for other in _NEEDS.get(key, ()) if other not in given]
        if missing:
            raise ConfigError(f"{path}: {missing[0]} is missing: {key} = {value!r} needs it")
    return given


def _readable(path: Path, key: str, value: str) -> None:
    try:
        Path(value).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: {key} = {value!r}: cannot be read ({error})") from None


def _tls(path: Path, given: dict[str, Any]) -> dict[str, Any]:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    tls = {"root_ca_certificate": given["tls_ca_file"], "close_link_on_expiration": True}
    try:
        context.load_verify_locations(given["tls_ca_file"])
        if "tls_certificate_file" in given:
            certificate, key = given["tls_certificate_file"], given["tls_key_file"]
            context.load_cert_chain(certificate, key, password=str)
            tls |= {"enable_mtls": True, "connect_certificate": certificate, "connect_private_key": key}
    except ssl.SSLError as error:
        raise ConfigError(f"{path}: its certificates or its key are wrong ({error.reason or error})") from None
    return tls
