"""What DataFlash messages look like: the definitions that ArduCopter 4.7 writes into its logs.

Sources: libraries/AP_Logger/LogStructure.h (FMT, UNIT, MULT, FMTU, PARM, MSG,
RCOU, ...), AP_AttitudeControl/LogStructure.h (RATE, ANG), AP_InertialSensor/
LogStructure.h (IMU, ACC), AP_Motors (MOTB), AP_ESC_Telem (ESC), AP_BattMonitor
(BAT), ArduCopter/Log.cpp (SIDD); checked against logs of that firmware. Each
log defines its types itself, so the numbers only have to be unique.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

#: The two bytes that start every message, as a little-endian integer.
HEADER: Final = 0x95A3

#: numpy type per format character (LogStructure.h); c, C, e, E store hundredths.
CHARACTERS: Final = {
    "b": "i1",
    "B": "u1",
    "h": "<i2",
    "H": "<u2",
    "i": "<i4",
    "I": "<u4",
    "q": "<i8",
    "Q": "<u8",
    "f": "<f4",
    "d": "<f8",
    "n": "S4",
    "N": "S16",
    "Z": "S64",
    "c": "<i2",
    "M": "u1",
    "a": "(32,)<i2",
}
#: Defined in a log that holds them only.
BATCHES: Final = ("ISBH", "ISBD")
#: The same, of position controllers: by direction.
POSITIONS: Final = {"north": "PSCN", "east": "PSCE", "down": "PSCD"}
#: Their columns but for the direction's letter: desired, target, actual position, velocity, acceleration.
POSITION_LABELS: Final = ("DP", "TP", "P", "DV", "TV", "V", "DA", "TA", "A")


class Message(NamedTuple):
    """One message type: its FMT and FMTU."""

    name: str
    number: int
    format: str
    columns: str
    units: str
    multipliers: str

    @property
    def dtype(self) -> np.dtype[np.void]:
        """The packed row with its three header bytes."""
        fields = [("header", "<u2"), ("number", "u1")]
        names = self.columns.split(",")
        fields += [(name, CHARACTERS[char]) for name, char in zip(names, self.format, strict=True)]
        return np.dtype(fields)


def _outputs(name: str, number: int, first: int, last: int) -> Message:
    """Describe one of the messages among which the output channels are divided."""
    channels = range(first, last + 1)
    n = len(channels)
    columns = ",".join(["TimeUS", *(f"C{channel}" for channel in channels)])
    return Message(name, number, "Q" + "H" * n, columns, "s" + "Y" * n, "F" + "-" * n)


MESSAGES: Final = {
    message.name: message
    for message in (
        Message("FMT", 128, "BBnNZ", "Type,Length,Name,Format,Columns", "-b---", "-----"),
        Message("UNIT", 117, "QbZ", "TimeUS,Id,Label", "s--", "F--"),
        Message("MULT", 118, "Qbd", "TimeUS,Id,Mult", "s--", "F--"),
        Message("FMTU", 116, "QBNN", "TimeUS,FmtType,UnitIds,MultIds", "s---", "F---"),
        Message("PARM", 32, "QNff", "TimeUS,Name,Value,Default", "s---", "F---"),
        Message("MSG", 59, "QZ", "TimeUS,Message", "s-", "F-"),
        Message(
            "VER",
            206,
            "QBHBBBBIZHBBII",
            "TimeUS,BT,BST,Maj,Min,Pat,FWT,GH,FWS,APJ,BU,FV,IMI,ICI",
            "s-------------",
            "F-------------",
        ),
        Message("MODE", 120, "QMBB", "TimeUS,Mode,ModeNum,Rsn", "s---", "F---"),
        Message("ARM", 186, "QBIBB", "TimeUS,ArmState,ArmChecks,Forced,Method", "s----", "F----"),
        Message("EV", 181, "QB", "TimeUS,Id", "s-", "F-"),
        Message(
            "RATE",
            75,
            "Qfffffffffffff",
            "TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut,AOutSlew",
            "skk-kk-kk-oo--",
            "F?????????BB--",
        ),
        *(
            Message(
                name,
                number,
                "QffffffffffB",
                "TimeUS,Tar,Act,Err,P,I,D,FF,DFF,Dmod,SRate,Flags",
                "s-----------",
                "F-----------",
            )
            for name, number in (("PIDR", 103), ("PIDP", 104), ("PIDY", 105))
        ),
        Message(
            "ANG",
            195,
            "Qfffffff",
            "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,Dt",
            "sddddhhs",
            "F0000000",
        ),
        Message(
            "ATT",
            72,
            "QffffffB",
            "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,AEKF",
            "sddddhh-",
            "F000000-",
        ),
        Message(
            "IMU",
            163,
            "QBffffffIIfBBHH",
            "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz",
            "s#EEEooo--O--zz",
            "F-000000-----00",
        ),
        Message("ACC", 161, "QBQfff", "TimeUS,I,SampleUS,AccX,AccY,AccZ", "s#sooo", "F-F000"),
        Message(
            "ISBH",
            164,
            "QHBBHHQf",
            "TimeUS,N,type,instance,mul,smp_cnt,SampleUS,smp_rate",
            "s-----sz",
            "F-----F-",
        ),
        Message("ISBD", 165, "QHHaaa", "TimeUS,N,seqno,x,y,z", "s--ooo", "F--???"),
        *(
            Message(
                name,
                number,
                "Qfffffffff",
                "TimeUS," + ",".join(f"{label}{name[-1]}" for label in POSITION_LABELS),
                "smmmnnnooo",
                "F000000000",
            )
            for number, name in enumerate(POSITIONS.values(), start=188)
        ),
        _outputs("RCOU", 62, 1, 14),
        _outputs("RCO2", 207, 15, 18),
        _outputs("RCO3", 208, 19, 32),
        Message(
            "MOTB",
            205,
            "QfffffB",
            "TimeUS,LiftMax,BatVolt,ThLimit,ThrAvMx,ThrOut,FailFlags",
            "s------",
            "F------",
        ),
        Message(
            "ESC",
            86,
            "QBffffcfcf",
            "TimeUS,Instance,RPM,RawRPM,Volt,Curr,Temp,CTot,MotTemp,Err",
            "s#qqvAOaO%",
            "F-00--BCB-",
        ),
        Message(
            "BAT",
            88,
            "QBfffffcfBBB",
            "TimeUS,Inst,Volt,VoltR,Curr,CurrTot,EnrgTot,Temp,Res,RemPct,H,SH",
            "s#vvAaXOw%-%",
            "F-000C0?0000",
        ),
        Message("SIDD", 9, "Qfffffffff", "TimeUS,Time,Targ,F,Gx,Gy,Gz,Ax,Ay,Az", "ss-zkkkooo", "F---------"),
    )
}

#: UNIT: the names of the unit characters.
UNITS: Final = {
    "-": "",
    "?": "UNKNOWN",
    "A": "A",
    "a": "Ah",
    "d": "deg",
    "b": "B",
    "B": "B/s",
    "k": "deg/s",
    "D": "deglatitude",
    "e": "deg/s/s",
    "E": "rad/s",
    "G": "Gauss",
    "h": "degheading",
    "i": "A.s",
    "J": "W.s",
    "l": "l",
    "L": "rad/s/s",
    "m": "m",
    "n": "m/s",
    "o": "m/s/s",
    "O": "degC",
    "%": "%",
    "S": "satellites",
    "s": "s",
    "t": "N.m",
    "q": "rpm",
    "r": "rad",
    "U": "deglongitude",
    "u": "ppm",
    "v": "V",
    "P": "Pa",
    "w": "Ohm",
    "W": "Watt",
    "X": "W.h",
    "y": "l/s",
    "Y": "us",
    "z": "Hz",
    "#": "instance",
}

#: MULT: the factors of the multiplier characters. ArduPilot stores most of them as rounded
#: to single precision (0.1f); a reader that compares must see the same double.
MULTIPLIERS: Final = {
    "-": 0.0,
    "?": 1.0,
    "2": 100.0,
    "1": 10.0,
    "0": 1.0,
    "A": float(np.float32(1e-1)),
    "B": float(np.float32(1e-2)),
    "C": float(np.float32(1e-3)),
    "D": float(np.float32(1e-4)),
    "E": float(np.float32(1e-5)),
    "F": float(np.float32(1e-6)),
    "G": float(np.float32(1e-7)),
    "I": float(np.float32(1e-9)),
    "!": float(np.float32(3.6)),
    "/": 3600.0,
}
