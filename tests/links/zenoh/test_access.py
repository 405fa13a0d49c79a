"""Zenoh between machines: a router with the access control that comes along, the rightful, and forgers of every kind.

The router is a Python session in mode router with `config/zenoh/router.json5`; it runs the code of zenohd.
"""

import re
import socket
import stat

import pytest
import zenoh
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.errors import ConfigError, LinkError
from guidance.links.evaders.zenoh import open_source
from guidance.links.opening import open_wire
from guidance.links.port import parse
from guidance.links.zenoh.access import ZenohSection, credentials_of, read_credentials
from guidance.links.zenoh.credentials import NO_CREDENTIALS, Credentials, certificate_credentials
from guidance.links.zenoh.keys import make_keys
from guidance.links.zenoh.session import open_router, open_session
from guidance.links.zenoh.wire import session_to
from guidance.log.broadcast import Broadcast, LiveFlight
from guidance.session.orders.control_bus import owner_token
from guidance.session.orders.control_client import join_session
from guidance.session.orders.mailbox import Mailbox
from guidance.session.orders_section import Control
from sitl_mock.errors import ConfigError as MockConfigError
from sitl_mock.transports.zenoh_session import ZenohEndpoint, read_keys
from tests.harness.bus import ControlBus, ask
from tests.links.peer import until
from tests.links.rigs import clock, free_port
from tests.links.zenoh.parties import CENTURY, FRAME, PARTIES, ROUTER, SAID, folder_of_keys, of

OUT = "uav1/mavlink_raw/out"
IN = "uav1/mavlink_raw/in"
REPORT = "evader1/report"
LIVE = "guidance/uav1/live/cycle"


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    return folder_of_keys(tmp_path_factory)


@pytest.fixture(scope="module")
def strangers(tmp_path_factory):
    """The same names, signed by another authority."""
    return folder_of_keys(tmp_path_factory)


@pytest.fixture(scope="module")
def port(keys):
    port = free_port(socket.SOCK_STREAM)
    with open_router(ROUTER, keys, f"tls/127.0.0.1:{port}"):
        yield port


@pytest.fixture
def joined(keys, port):
    """Sessions of parties; closed with the test."""
    opened = []

    def join(name):
        session = open_session(f"tls/127.0.0.1:{port}", credentials=of(keys, name))
        opened.append(session)
        return session

    yield join
    for session in opened:
        session.close()


def test_each_party_reaches_the_subscribers_of_its_keys(keys, port, joined):
    url = f"zenoh://127.0.0.1:{port}/uav1"
    mine = of(keys, "uav1-guidance")
    mock = ZenohEndpoint(
        ["uav1"],
        f"tls/127.0.0.1:{port}",
        mode="client",
        connect=True,
        keys=read_keys(keys / "uav1.toml"),
    )
    wire = open_wire(url, clock=clock, credentials=mine)
    reports = open_source(
        "json",
        f"zenoh://127.0.0.1:{port}/{REPORT}",
        clock=clock,
        frame=FRAME,
        credentials=mine,
    )
    owner = owner_token(joined("uav1-guidance"), "uav1/guidance")
    try:
        evader = joined("evader1").declare_publisher(REPORT)
        heard = []
        told = []
        seen = []

        def all_arrived():
            mock.send("uav1", "onboard", [b"telemetry"])
            wire.send(b"setpoint")
            evader.put(SAID)
            heard.extend(data for _, data in wire.receive())
            told.extend(arrival.data for arrival in mock.receive())
            seen.extend(report.latitude_deg for report in reports.receive())
            return heard and told and seen

        assert until(all_arrived)
        assert (set(heard), set(told), set(seen)) == ({b"telemetry"}, {b"setpoint"}, {47.4})
        with pytest.raises(LinkError, match="another daemon owns this vehicle"):
            owner_token(joined("uav1-guidance"), "uav1/guidance")
    finally:
        owner.undeclare()
        reports.close()
        wire.close()
        mock.close()


def test_an_operator_orders_and_a_viewer_looks_on(keys, port):
    endpoint = f"tls/127.0.0.1:{port}"
    mailbox = Mailbox()
    mailbox.meanwhile = lambda order: {"accepted": True, "order": order, "name": "uav1"}
    bus = ControlBus(
        "uav1",
        mailbox,
        Control(endpoint=endpoint, host=False),
        credentials=of(keys, "uav1-guidance"),
    )
    broadcast = Broadcast("uav1", bus.session, {"seed": "3"})
    try:
        operator = of(keys, "operator")
        assert ask("hold", endpoint=endpoint, name=None, credentials=operator)["order"] == "hold"
        for other in ("viewer", "evader1", "uav1"):
            with pytest.raises(LinkError, match="no answer"):
                ask(
                    "land",
                    endpoint=endpoint,
                    name="uav1",
                    timeout_s=0.3,
                    credentials=of(keys, other),
                )
        with join_session(endpoint, credentials=of(keys, "viewer")) as session:
            view = LiveFlight(session)
            assert view.metadata(lambda: False) == {"seed": "3"}
            items = []
            assert until(
                lambda: (
                    broadcast.event(1.0, "happened")
                    or items.extend(view.items(lambda: True))
                    or items
                )
            )
            assert items[0].topic == "guidance/event"
    finally:
        broadcast.close()
        bus.close()


def certificate_of(keys, strangers, kind):
    authority = {"root_ca_certificate": str(keys / "ca.pem")}
    if kind == "nothing":
        return NO_CREDENTIALS
    if kind == "no certificate":
        return Credentials(tls=authority)
    if kind == "another authority's":
        return Credentials(tls={**of(strangers, "uav1-guidance").tls, **authority})
    if kind == "the router is a stranger":
        return of(strangers, "uav1-guidance")
    return Credentials(
        auth={"usrpwd": {"user": "uav1-guidance", "password": "guessed"}}, tls=authority
    )


@pytest.mark.parametrize(
    "kind",
    ["nothing", "no certificate", "another authority's", "the router is a stranger", "a password"],
)
def test_without_a_certificate_of_ours_no_client_connects(keys, strangers, port, kind):
    credentials = certificate_of(keys, strangers, kind)
    with pytest.raises(LinkError, match="no session within"):
        session_to(parse(f"zenoh://127.0.0.1:{port}"), credentials, 0.7)


def test_a_party_cannot_pose_as_the_router(keys, tmp_path):
    for name, file in (
        ("ca.pem", "ca.pem"),
        ("router.pem", "viewer.pem"),
        ("router.key", "viewer.key"),
    ):
        (tmp_path / name).write_bytes((keys / file).read_bytes())
    port = free_port(socket.SOCK_STREAM)
    with (
        open_router(ROUTER, tmp_path, f"tls/127.0.0.1:{port}"),
        pytest.raises(LinkError, match="certificate for this host"),
    ):
        open_session(f"tls/127.0.0.1:{port}", timeout_s=0.7, credentials=of(keys, "uav1-guidance"))


SAYS = {OUT: "uav1", IN: "uav1-guidance", REPORT: "evader1", LIVE: "uav1-guidance"}
HEARS = {
    OUT: ("uav1-guidance", "viewer"),
    IN: ("uav1",),
    REPORT: ("uav1-guidance",),
    LIVE: ("operator", "viewer"),
}


def test_no_party_uses_keys_that_are_not_its_own(joined):
    """Every party publishes on every key; exactly the messages that the table allows arrive."""
    sessions = {name: joined(name) for name in PARTIES}
    heard = {(name, key): set() for name in PARTIES for key in SAYS}
    for (name, key), said in heard.items():
        note = said.add
        sessions[name].declare_subscriber(
            key,
            lambda sample, note=note: note(sample.payload.to_string()),
            allowed_origin=zenoh.Locality.REMOTE,
        )
    forgers = {name: joined(name) for name in PARTIES}
    for name, session in forgers.items():
        for key, sayer in SAYS.items():
            if name != sayer:
                for _ in range(3):
                    session.put(key, name, congestion_control=zenoh.CongestionControl.BLOCK)
        session.put("**", name)
        session.close()
    allowed = {(name, key): {SAYS[key]} for key, names in HEARS.items() for name in names}

    def rightful():
        for key, name in SAYS.items():
            sessions[name].put(key, name)
        return {place: said for place, said in heard.items() if said} == allowed

    assert until(rightful)
    assert {place: said for place, said in heard.items() if said} == allowed


def test_only_the_daemon_answers_orders_and_claims_the_vehicle(joined):
    mine = joined("uav1-guidance")
    operator = joined("operator")
    forger = joined("evader1")
    claimed = owner_token(forger, "uav1/guidance")
    owner_token(mine, "uav1/guidance").undeclare()  # the claim of a stranger is none
    claimed.undeclare()
    key = "guidance/uav1/ctl/status"
    forged = forger.declare_queryable(key, lambda query: query.reply(key, b"forged"))
    rightful = mine.declare_queryable(key, lambda query: query.reply(key, b"rightful"))

    def answers():
        return {
            reply.ok.payload.to_string()
            for reply in operator.get(key, timeout=1.0, target=zenoh.QueryTarget.ALL)
            if reply.ok is not None
        }

    assert until(lambda: answers() == {"rightful"})
    forged.undeclare()
    rightful.undeclare()


def by_password(keys, folder):
    """The shipped configuration with the changes that docs/zenoh.md names."""
    users = folder / "users.txt"
    users.write_text("uav1-guidance:right\nevader1:other\n")
    text = ROUTER.read_text().replace("enable_mtls: true", "enable_mtls: false")
    text = (
        text.replace("cert_common_names", "usernames")
        .replace("// auth:", "auth:")
        .replace("keys/users.txt", str(users))
    )
    path = folder / "router.json5"
    path.write_text(text)
    return path


def test_the_password_identifies_the_user(keys, tmp_path):
    def user(name, password):
        auth = {"usrpwd": {"user": name, "password": password}}
        return Credentials(auth=auth, tls={"root_ca_certificate": str(keys / "ca.pem")})

    endpoint = f"tls/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    with open_router(by_password(keys, tmp_path), keys, endpoint):
        for credentials in (
            user("uav1-guidance", "wrong"),
            user("root", "right"),
            user("evader1", "right"),
        ):
            with pytest.raises(LinkError, match="certificate or user"):
                open_session(endpoint, timeout_s=0.5, credentials=credentials)
        heard = set()
        with (
            open_session(endpoint, credentials=user("uav1-guidance", "right")) as mine,
            open_session(endpoint, credentials=user("evader1", "other")) as evader,
            mine.declare_subscriber(
                "**", lambda sample: heard.add((str(sample.key_expr), sample.payload.to_string()))
            ),
            mine.declare_subscriber(
                REPORT, lambda sample: heard.add((str(sample.key_expr), sample.payload.to_string()))
            ),
        ):
            evader.put(OUT, "forged")
            assert until(lambda: evader.put(REPORT, "said") or heard)
            assert heard == {(REPORT, "said")}


def mode(path):
    return stat.S_IMODE(path.stat().st_mode)


def test_keys_are_made_for_their_owner_and_added_to_and_never_overwritten(tmp_path):
    folder = tmp_path / "keys"
    run = CliRunner().invoke
    made = run(
        app,
        ["zenoh", "keys", "uav1", "--out", str(folder), "--host", "192.168.1.10"],
        catch_exceptions=False,
    )
    assert made.exit_code == 0
    assert str(folder / "uav1.toml") in made.output.split()
    assert mode(folder) == 0o700
    assert {path.name for path in folder.glob("*.key") if mode(path) == 0o600} == {
        "ca.key",
        "router.key",
        "uav1.key",
    }
    authority = (folder / "ca.pem").read_bytes()
    assert run(app, ["zenoh", "keys", "viewer", "--out", str(folder)]).exit_code == 0
    assert (folder / "ca.pem").read_bytes() == authority
    for name in ("uav1", "ca", "router"):
        again = run(app, ["zenoh", "keys", name, "--out", str(folder)])
        assert isinstance(again.exception, ConfigError)
        assert "already exists" in str(again.exception)
    (folder / "ca.key").write_bytes((folder / "uav1.key").read_bytes())
    with pytest.raises(ConfigError, match=r"is not the key of ca\.pem"):
        make_keys(folder, ["more"], ["localhost"], CENTURY)
    (folder / "ca.key").unlink()
    with pytest.raises(ConfigError, match="need the authority's key"):
        make_keys(folder, ["more"], ["localhost"], CENTURY)


@pytest.mark.parametrize("name", ["ca.pem", "uav1.toml", "uav1.key"])
def test_no_key_or_certificate_is_written_through_a_symbolic_link(tmp_path, name):
    folder = tmp_path / "keys"
    folder.mkdir()
    (folder / name).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match="symbolic links"):
        make_keys(folder, ["uav1"], [], CENTURY)
    assert not (tmp_path / "elsewhere").exists()


def test_a_router_passes_no_message_of_more_than_a_megabyte(joined):
    heard = set()
    publisher = joined("uav1").declare_publisher(OUT)
    subscriber = joined("uav1-guidance").declare_subscriber(
        OUT, lambda sample: heard.add(len(sample.payload))
    )
    assert until(lambda: publisher.put(bytes(1_000_000)) or 1_000_000 in heard)
    publisher.put(bytes(1_100_000))
    assert until(lambda: publisher.put(b"!") or 1 in heard)
    assert heard == {1_000_000, 1}
    subscriber.undeclare()
    publisher.undeclare()


def test_a_router_names_missing_files_and_used_ports(tmp_path, keys, port):
    with pytest.raises(ConfigError, match=r"ca\.pem is missing"):
        open_router(ROUTER, tmp_path)
    with pytest.raises(ConfigError, match="no such file"):
        open_router(tmp_path / "none.json5", keys)
    (tmp_path / "wrong.json5").write_text('{mode: "queen"}')
    with pytest.raises(ConfigError, match="not a Zenoh configuration"):
        open_router(tmp_path / "wrong.json5")
    with pytest.raises(LinkError, match="is its port in use"):
        open_router(ROUTER, keys, f"tls/127.0.0.1:{port}")


WRONG = {
    "no pair": (
        {"tls_certificate_file": "uav1.pem", "tls_key_file": "viewer.key"},
        r"uav1\.pem.*viewer\.key.*not a certificate and its key",
    ),
    "no such file": ({"tls_ca_file": "none.pem"}, r"tls_ca_file = '.*none\.pem'.*No such file"),
    "no certificate": (
        {"tls_ca_file": "uav1.toml"},
        r"tls_ca_file = '.*uav1\.toml'.*not a PEM certificate",
    ),
    "no authority": ({"tls_ca_file": None}, r"tls_ca_file.*missing"),
    "no key": ({"tls_key_file": None}, r"tls_key_file.*missing"),
    "no password": ({"user": "uav1"}, r"password_file.*missing"),
    "open password": (
        {"user": "uav1", "password_file": "open"},
        r"password_file = '.*open'.*others may read it",
    ),
    "long password": (
        {"user": "uav1", "password_file": "long"},
        r"password_file = '.*long'.*one line",
    ),
    "unknown": ({"tls_ca": "ca.pem"}, r"tls_ca: unknown key; did you mean 'tls_ca_file'"),
}


@pytest.mark.parametrize(("changes", "said"), WRONG.values(), ids=WRONG)
def test_errors_in_a_section_name_the_key_and_the_file(keys, changes, said):
    (keys / "open").write_text("secret\n")
    (keys / "open").chmod(0o644)
    (keys / "long").write_text("two\nlines\n")
    (keys / "long").chmod(0o600)
    good = {"tls_ca_file": "ca.pem", "tls_certificate_file": "uav1.pem", "tls_key_file": "uav1.key"}
    given = {key: value for key, value in (good | changes).items() if value is not None}
    path = keys / "given.toml"
    path.write_text("".join(f'{key} = "{value}"\n' for key, value in given.items()))
    with pytest.raises(ConfigError, match=f"(?s){said}") as full:
        read_credentials(path)
    if given.keys() == good.keys():
        with pytest.raises(ConfigError, match=re.escape(str(full.value))):
            certificate_credentials(path)
    else:
        assert certificate_credentials(path) is None
    if "others" not in said and "one line" not in said:  # the mock has no secrets
        with pytest.raises(MockConfigError, match=r"given\.toml"):
            read_keys(path)


def test_the_short_way_to_a_partys_credentials_is_the_full_one(keys, tmp_path):
    assert certificate_credentials(keys / "uav1.toml") == of(keys, "uav1")
    (tmp_path / "ca.toml").write_text(f'tls_ca_file = "{keys / "ca.pem"}"\n')
    assert certificate_credentials(tmp_path / "ca.toml") is None
    assert of(tmp_path, "ca").tls["root_ca_certificate"] == str(keys / "ca.pem")
    (tmp_path / "wrong.toml").write_text("tls_ca_file = [\n")
    for read in (read_credentials, certificate_credentials):
        with pytest.raises(ConfigError, match=r"wrong\.toml: not valid TOML"):
            read(tmp_path / "wrong.toml")


def test_a_key_that_others_may_read_is_refused(keys, tmp_path):
    for name in ("ca.pem", "uav1.pem", "uav1.key"):
        (tmp_path / name).write_bytes((keys / name).read_bytes())
    (tmp_path / "uav1.key").chmod(0o640)
    section = ZenohSection(
        tls_ca_file="ca.pem", tls_certificate_file="uav1.pem", tls_key_file="uav1.key"
    )
    with pytest.raises(
        ConfigError, match=r"zenoh\.tls_key_file = '.*uav1\.key': others may read it; chmod 600 it"
    ):
        credentials_of(section.beside(tmp_path))
