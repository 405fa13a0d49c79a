"""Certificates for a Zenoh network: one authority, a router, and one certificate for each party.

Elliptic-curve keys (P-256). The certificate of a party is for clients only, so no party can pose as the router.
Needs the extra `keys`.
"""

import datetime
import ipaddress
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from guidance.errors import ConfigError
from guidance.files import private_file, private_folder, read_text
from guidance.links.zenoh.credentials import AUTHORITY, ROUTER

_SIGNING: Final = x509.KeyUsage(False, False, False, False, False, True, True, False, False)
"""The authority's key signs only certificates and their revocation lists (`key_cert_sign`, `crl_sign`)."""


class KeyPair(NamedTuple):
    """A private key and its certificate."""

    key: ec.EllipticCurvePrivateKey
    certificate: x509.Certificate


Validity = tuple[datetime.datetime, datetime.datetime]
"""Begin and end of a certificate's validity."""


def make_keys(
    folder: Path, parties: Sequence[str], hosts: Sequence[str], validity: Validity
) -> list[Path]:
    """Create the missing files in a folder: the authority, the router's certificate, and one for each party.

    Args:
        folder: For the PEM files, and NAME.toml for each party with the keys of `[zenoh]`.
        parties: Common names, as in the router's access control.
        hosts: Names and addresses of the router.
        validity: The same for every certificate.

    Returns:
        The files written.

    Raises:
        ConfigError: If a party already has a certificate there, or the key of the authority is missing.
        OSError: If a file cannot be written.
    """
    for name in parties:
        if name in {AUTHORITY, ROUTER} or (folder / f"{name}.pem").exists():
            raise ConfigError(
                f"{folder / name}.pem: already exists; choose another name or remove it"
            )
    private_folder(folder)
    written: list[Path] = []
    if (folder / f"{AUTHORITY}.pem").exists():
        path = folder / f"{AUTHORITY}.key"
        try:
            key = serialization.load_pem_private_key(read_text(path).encode(), None)
            certificate = x509.load_pem_x509_certificate(
                read_text(folder / f"{AUTHORITY}.pem").encode()
            )
        except OSError as error:
            need = "certificates need the authority's key"
            raise ConfigError(f"{path}: cannot be read ({error.strerror}); {need}") from error
        except (ValueError, TypeError) as error:
            raise ConfigError(
                f"{path} and its .pem: not a key and certificate in PEM ({error})"
            ) from error
        if (
            not isinstance(key, ec.EllipticCurvePrivateKey)
            or certificate.public_key() != key.public_key()
        ):
            raise ConfigError(f"{path}: is not the key of {AUTHORITY}.pem")
        authority = KeyPair(key, certificate)
    else:
        authority = _new_certificate(
            None, "pursuit guidance test authority", validity, [(_SIGNING, True)]
        )
        written += _write(folder, AUTHORITY, authority)
    if not (folder / f"{ROUTER}.pem").exists():
        written += _write(
            folder,
            ROUTER,
            _signed(authority, ROUTER, hosts, ExtendedKeyUsageOID.SERVER_AUTH, validity),
        )
    for name in parties:
        written += _write(
            folder, name, _signed(authority, name, (), ExtendedKeyUsageOID.CLIENT_AUTH, validity)
        )
        keys = f'tls_ca_file = "{AUTHORITY}.pem"\ntls_certificate_file = "{name}.pem"\ntls_key_file = "{name}.key"\n'
        written.append(folder / f"{name}.toml")
        private_file(written[-1]).write_text(keys, encoding="utf-8")
    return written


def _signed(
    authority: KeyPair,
    common_name: str,
    hosts: Sequence[str],
    use: x509.ObjectIdentifier,
    validity: Validity,
) -> KeyPair:
    names: list[x509.GeneralName] = []
    for host in hosts or (common_name,):
        try:
            names.append(x509.IPAddress(ipaddress.ip_address(host)))
        except ValueError:
            names.append(x509.DNSName(host))
    called = x509.SubjectAlternativeName(names)
    return _new_certificate(
        authority, common_name, validity, [(called, False), (x509.ExtendedKeyUsage([use]), False)]
    )


def _new_certificate(
    authority: KeyPair | None,
    name: str,
    validity: Validity,
    extensions: Sequence[tuple[x509.ExtensionType, bool]],
) -> KeyPair:
    """Return a new key and its certificate, self-signed without an authority. Extensions may be critical (True)."""
    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    issuer = subject if authority is None else authority.certificate.subject
    built = x509.CertificateBuilder(
        issuer, subject, key.public_key(), x509.random_serial_number(), *validity
    )
    constraints = x509.BasicConstraints(
        ca=authority is None, path_length=0 if authority is None else None
    )
    for extension, critical in ((constraints, True), *extensions):
        built = built.add_extension(extension, critical=critical)
    return KeyPair(key, built.sign(key if authority is None else authority.key, hashes.SHA256()))


def _write(folder: Path, name: str, pair: KeyPair) -> list[Path]:
    certificate = folder / f"{name}.pem"
    key = folder / f"{name}.key"
    pem = serialization.Encoding.PEM
    plain = serialization.NoEncryption()
    private_file(key).write_bytes(
        pair.key.private_bytes(pem, serialization.PrivateFormat.PKCS8, plain)
    )
    private_file(certificate).write_bytes(pair.certificate.public_bytes(pem))
    return [certificate, key]
