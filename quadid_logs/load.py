"""From a file to a log on one clock with its torque; the content decides the format, not the file name."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from quadid_logs.actuation import Torques, reconstruct
from quadid_logs.align import Prepared, assemble, clean, cut
from quadid_logs.autopilots import format_of, formats, named
from quadid_logs.containers.foreign import explain_foreign
from quadid_logs.data.log import FlightLog
from quadid_logs.data.settings import Settings
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.errors import EmptyLogError, LogNotFoundError, SettingsError, UnknownFormatError
from quadid_logs.identify.torque_choice import compare_torques

_HEAD_BYTES: Final = 1 << 16


def load(path: str | Path, settings: Settings | None = None, vehicle: Vehicle | None = None) -> Prepared:
    """Read a log, align it to one clock and rebuild its torque: the input of every command.

    Parameters
    ----------
    path : str or Path
    settings : Settings, optional
        Only ``system`` and ``log`` are used.
    vehicle : Vehicle, optional
        Known properties of the vehicle. They take precedence over the log's parameters.

    Returns
    -------
    Prepared
        Input of `align.cut`, which resamples the selected part.

    Raises
    ------
    LogError
        If the file cannot be read as a flight log at all; see `read_log`.
    """
    wanted = settings or Settings()
    return prepare(read_log(path, system=wanted.system, number=wanted.log), vehicle)


def prepare(log: FlightLog, vehicle: Vehicle | None = None) -> Prepared:
    """Align a log in memory to one clock and rebuild its torque.

    Parameters
    ----------
    log : FlightLog
    vehicle : Vehicle, optional
        Known properties of the vehicle. They take precedence over the log's parameters.

    Returns
    -------
    Prepared
        The airframe is in ``log.torque``.
    """
    autopilot = named(log.autopilot)
    cleaned = clean(log)
    torques = reconstruct(cleaned, autopilot, vehicle)
    loop_rate_hz = autopilot.loop_rate_hz(log.parameters)
    modes = {one.name for one in log.modes}
    gains = {name: found for name in modes if (found := autopilot.angle_gains(name, log.parameters))}

    of_sticks = {name: full for name in modes if (full := autopilot.stick_gains(name, log.parameters))}

    def assembled(chosen: Torques) -> Prepared:
        return assemble(
            replace(log, torque=chosen.model), cleaned, chosen.sources, loop_rate_hz, gains, of_sticks
        )

    prepared, without = assembled(torques), torques.without_speeds
    return prepared if without is None else _chosen(prepared, assembled(without))


def _chosen(preferred: Prepared, other: Prepared) -> Prepared:
    """Return the torque that the flight supports, of two, with the comparison."""
    settings = Settings()
    first, second = (cut(each, settings.align) for each in (preferred, other))
    found = compare_torques(first, second, settings.identify)
    if found is None:
        return preferred
    chosen = preferred if found.takes_preferred else other
    torque = chosen.log.torque
    if torque is None:
        return preferred
    unlike = "; not used, the motor commands predict validation data better"
    verdict = torque.rotor_speed if found.takes_preferred else f"{torque.rotor_speed}{unlike}"
    return replace(
        chosen, log=replace(chosen.log, torque=replace(torque, rotor_speed=verdict, comparison=found))
    )


def read_log(path: str | Path, *, system: int = 0, number: int = 0) -> FlightLog:
    """Read a flight log of any known format.

    Parameters
    ----------
    path : str or Path
        File of any registered format, which is recognised by its content.
    system : int
        MAVLink system to read from a telemetry log; 0 selects the autopilot.
    number : int
        Number of the log in a file with several logs, from 1; 0 takes the only one.

    Returns
    -------
    FlightLog
        Signals by canonical name in file order, and the lost bytes.

    Raises
    ------
    LogNotFoundError
        If there is no readable regular file at the path.
    EmptyLogError
        If the file is empty, or holds nothing usable.
    UnknownFormatError
        If the content is not a recognised log; the hint says what it looks like.
    SettingsError
        If `system` or `number` is not in the file.
    SeveralLogsError
        If the file holds several logs and no `number` was given.

    Examples
    --------
    >>> from quadid_logs import read_log
    >>> log = read_log("sample_logs/doublets.tlog")
    >>> log.format, {signal.values.shape[1] for signal in log.signals["body_rate"]}
    ('tlog', {3})
    """
    head = _read_head(Path(path))
    if not head:
        raise EmptyLogError(
            f"{path} is empty (0 bytes).",
            hint="Download the log again. Logs are only complete after disarming.",
        )
    log_format = format_of(head)
    if log_format is not None:
        if number > 1 and log_format.read_numbered is None:
            raise SettingsError(
                f"There is no log {number} in {path}.", hint="A file of this format holds one log."
            )
        # What damage can make of the bytes becomes one clear error.
        try:
            # Damaged numbers may be signalling NaN or near overflow: they pass on as NaN or infinity,
            # silently.
            with np.errstate(invalid="ignore", over="ignore"):
                if log_format.read_numbered is not None:
                    return log_format.read_numbered(path, system=system, number=number)
                return log_format.read(path, system=system)
        except OSError as error:
            raise LogNotFoundError(
                f"{path} cannot be read: {error}.", hint="Check the disk, and try again."
            ) from error
        except (struct.error, UnicodeError, IndexError, KeyError, OverflowError) as error:
            raise UnknownFormatError(
                f"{path} is damaged in a way that stops the reader ({type(error).__name__}: {error}).",
                hint="Please report it with the log.",
            ) from error
    # Name the formats and their common file endings.
    known_formats = ", ".join(f"{one.title} ({', '.join(one.suffixes)})" for one in formats())
    raise UnknownFormatError(
        f"{path} is not a recognised flight log.", hint=explain_foreign(head, known_formats)
    )


def _read_head(path: Path) -> bytes:
    """Return the file's first bytes."""
    try:
        if path.exists() and not path.is_file():
            kind = "a directory" if path.is_dir() else "not a regular file"
            raise LogNotFoundError(f"{path} is {kind}.", hint="Give the path of one log file.")
        with path.open("rb") as file:
            return file.read(_HEAD_BYTES)
    except FileNotFoundError as error:
        raise LogNotFoundError(f"There is no file {path}.", hint="Check the path.") from error
    except (OSError, ValueError) as error:
        # ValueError: a path with a null character.
        raise LogNotFoundError(
            f"{path} cannot be read: {error}.", hint="Check path and permissions."
        ) from error
