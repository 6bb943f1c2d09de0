"""What every finding means and what to do about it: the one text for report, `explain` and docs.

What to set on a certain autopilot stands in its folder (`Advice.remedies` by code), not here.

Codes: QL1xx the file, QL2xx the vehicle, QL3xx what was logged and how fast,
QL4xx the flight, QL5xx the model, QL6xx the loop.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

#: What its advice is: to be set before the next flight, the manoeuvre to fly, or anything else.
Step = Literal["set", "fly", "other"]
#: What it judges: the model of an axis, whose verdict it decides; the loop that the controller makes of the
#: vehicle, where the model is as good as it was; whether gains can be advised; or the state of the vehicle,
#: which decides no verdict.
Scope = Literal["model", "loop", "gains", "vehicle"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CatalogueEntry:
    """A kind of finding: its title, what it means, what to fly or set next, and what it judges."""

    code: str
    title: str
    meaning: str
    advice: str
    step: Step
    scope: Scope


#: The doublets that are advised turn a vehicle at 14 to 25 deg/s rms (yaw least): an axis that turns more
#: lacks no excitation.
WELL_EXCITED_DEG_S: Final = 20.0
#: What helps an axis that lacks no excitation.
CALMER: Final = (
    "Fly in calm air, away from the ground, with steady throttle and with motors off their limits."
)
_ENOUGH: Final = (
    f"Look at the rms rate in the evidence. Below {WELL_EXCITED_DEG_S:g} deg/s, fly stronger manoeuvres on "
    f"this axis. Above that, larger manoeuvres do not help. {CALMER}"
)

#: A vehicle that is at its limits in more of the samples needs less from its pilot, not other gains (QL617).
MOST_SATURATED: Final = 0.10
#: Standard deviation of the command that gyro noise may make, of its full range: motors stay cool.
MOST_NOISE: Final = 0.05
#: Stands in advice for the motor that a finding is about; a list of steps puts its name there.
THIS_MOTOR: Final = "this motor"

#: What makes an axis uncertain and its interval wide, and does not say that anything contradicts it.
CAVEATS: Final = frozenset(
    {"QL304", "QL403", "QL404", "QL503", "QL504", "QL505", "QL511", "QL523", "QL524", "QL531"}
    | {"QL533", "QL534", "QL535"}
)


def _entry(
    code: str, title: str, meaning: str, advice: str, *, step: Step = "other", scope: Scope = "model"
) -> tuple[str, CatalogueEntry]:
    return code, CatalogueEntry(
        code=code, title=title, meaning=meaning, advice=advice, step=step, scope=scope
    )


CATALOGUE: Final[Mapping[str, CatalogueEntry]] = MappingProxyType(
    dict(
        (
            _entry(
                "QL101",
                "Part of the file could not be read",
                "Some bytes of the file are not valid messages. The file was cut off or copied badly, or "
                "the card dropped blocks. Only the rows in those bytes are lost. All other rows are used.",
                "If the lost part lies in the manoeuvre, download the log again. If that does not help, "
                "fly once more.",
            ),
            _entry(
                "QL102",
                "The autopilot dropped log messages",
                "The logger could not keep up and left messages out. The log has gaps there. Gaps of up to "
                "50 ms are filled by a straight line. Longer gaps split the flight.",
                "Use a faster card, or log fewer message types.",
                step="set",
            ),
            _entry(
                "QL103",
                "The clock was reset or jumped",
                "Times fall or leap inside the file: the autopilot restarted, or its clock was set. The "
                "parts are analyzed separately and shown one after the other.",
                "Check in the report that each part is a flight of its own.",
            ),
            _entry(
                "QL104",
                "The log has no time column",
                "The rows have no time stamps, as with very old firmware. Without times no rate of change "
                "can be computed.",
                "Update the autopilot's firmware. Releases of the last ten years stamp every row.",
                step="set",
            ),
            _entry(
                "QL105",
                "Several systems are recorded in this file",
                "The file holds messages of more than one vehicle, autopilot or other device. One was "
                "analyzed. The evidence lists all of them.",
                "To analyze another one, add --system ID.",
            ),
            _entry(
                "QL106",
                "Some rows were repaired or left out",
                "Some rows were out of order, repeated a time stamp or had an impossible one. Others held "
                "no value, an absurd value or a spike of one sample. Such rows were sorted, merged or left "
                "out.",
                "Look at the evidence. If many rows are affected, use another card and log fewer message "
                "types.",
            ),
            _entry(
                "QL107",
                "One model was fitted to several logs",
                "The flights were put one after the other and fitted together. A difference between "
                "flights looks like a change in flight. Facts about the file are those of the first log.",
                "Pool only flights of one vehicle in one state. To compare flights, leave --pool out.",
            ),
            _entry(
                "QL201",
                "This is not a multirotor",
                "The model describes how torque turns a hovering body. It does not describe aeroplanes, "
                "VTOLs, helicopters, rovers, boats or submarines, so this tool does not judge them.",
                "Use a log of a multirotor. For another vehicle, use its autopilot's own log viewer.",
            ),
            _entry(
                "QL202",
                "The log does not say what the vehicle is",
                "No message or parameter names the vehicle type, so the vehicle is taken for a multirotor.",
                "Check that the report shows the vehicle that you flew.",
            ),
            _entry(
                "QL301",
                "The log holds no body rates",
                "The log holds neither the angular rates of a gyro nor those of the rate controller.",
                "Log the body rates and the IMU.",
                step="set",
            ),
            _entry(
                "QL302",
                "The log holds no torque",
                "A model needs torque as its input. The log holds no torque command, and no motor outputs "
                "from which the torque could be computed.",
                "Log the rate controller's outputs.",
                step="set",
            ),
            _entry(
                "QL303",
                "Logged too slowly to identify anything",
                "Between two samples, torque and rates change in ways that the log does not show. "
                "Interpolation would give inertias that are wrong by factors. Such an axis gets no number.",
                "Log rates and torque at 100 Hz or more.",
                step="set",
            ),
            _entry(
                "QL304",
                "Logged rather slowly",
                "The logging rate is high enough for the control effectiveness. It is hardly high enough "
                "to separate lag from effectiveness.",
                "Log rates and torque at 200 Hz or more.",
                step="set",
            ),
            _entry(
                "QL305",
                "The true logging rate is far below the nominal one",
                "Many samples are missing. The average rate of the signal is much lower than the time "
                "between neighbouring samples suggests.",
                "Use a faster card, or log fewer message types.",
                step="set",
            ),
            _entry(
                "QL306",
                "The attitude was not logged, or too slowly",
                "Only the structure with angles (linear-9) needs the attitude. That structure is left out, "
                "or its angles are interpolated.",
                "For the structure linear-9 only: log the attitude as fast as the body rates.",
                step="set",
            ),
            _entry(
                "QL307",
                "The mixer could not be recomputed",
                "Motor outputs follow from torque command, parameters and battery voltage. Outputs "
                "computed that way differ from the logged ones. This firmware mixes in another way, or the "
                "rows are too sparse to compare. The torque is used as it was commanded, and saturation is "
                "not detected.",
                "For the achieved torque, log three things with a current firmware: the rate controller's "
                "output, the motor outputs, and the mixer's battery compensation.",
                step="set",
            ),
            _entry(
                "QL308",
                "Geometry parameters are not used as calibration",
                "The autopilot's mixer takes rotor positions and thrust coefficients in arbitrary units. "
                "Some of these parameters were never set, or they contradict the hover. They do not "
                "measure this vehicle.",
                "Give mass_kg, arm_length_m and torque_to_thrust_m in --vehicle FILE.toml.",
            ),
            _entry(
                "QL309",
                "The log does not describe the airframe",
                "Without number, place and spin of the motors, no torque can be computed from motor "
                "outputs. A logged torque command is used as it is.",
                "Describe the rotors with [[rotor]] tables in --vehicle FILE.toml.",
            ),
            _entry(
                "QL310",
                "Gyro and attitude contradict each other",
                "Body rates, added up over tenths of a second, must give the change of roll, pitch and "
                "yaw. Here they do not. An axis has the wrong scale, sign or place, or one of the two "
                "signals comes late. The log alone does not show which of the two is wrong. Wrong rates "
                "make the control effectiveness wrong by the same factor.",
                "Check units, signs and order of a table's columns. On an autopilot, check its mounting "
                "orientation, and whether its main loop keeps up.",
            ),
            _entry(
                "QL311",
                "Only the most excited minutes of this long flight were used",
                "The twenty minutes with the most motion hold nearly all information of a flight. The rest "
                "would only cost time.",
                "To analyze another part, use --start-s and --end-s.",
            ),
            _entry(
                "QL312",
                "Rotor speeds and motor commands give different effectiveness",
                "The torque was computed twice: from the rotor speeds, and from the motor commands. The "
                "same model was fitted to each. The two values of the effectiveness differ by more than "
                "their intervals allow. The source that predicts validation data better was used, if they "
                "show a difference.",
                "Check the number of motor poles, and that each ESC reports its own motor. A simulator may "
                "compute rotor speeds that its thrust does not follow.",
            ),
            _entry(
                "QL313",
                "The commanded thrust in newtons is wrong",
                "In steady flight the thrust of all motors carries the weight. Here the controller "
                "commands another thrust. Motors or propellers are not those that its firmware assumes. "
                "The commanded torque in N m is wrong by the same factor, so no inertia is given. "
                "Effectiveness per command and the loop are not affected.",
                "To get newtons, measure the thrust of one motor against its command.",
            ),
            _entry(
                "QL320",
                "No multirotor turns at these body rates",
                "The rates, integrated, turn the vehicle upside down for much of its flight, or they "
                "exceed what a gyro can measure. Often the table holds deg/s where rad/s are needed. Every "
                "effectiveness is then 57 times too large.",
                "In a table, give the body rates in rad/s. If the vehicle tumbled, use --end-s to choose "
                "the flight before that. If it did fly like that, log the attitude too.",
            ),
            _entry(
                "QL321",
                "No rate set-points were used",
                "The controller answers gusts with torque, so torque and gusts go together. Set-points do "
                "not answer gusts, so they give an unbiased estimate. Without set-points the effectiveness "
                "may be too low, above all if the model explains little of the motion. The interval covers "
                "that.",
                "Log the rate set-points together with the rates.",
            ),
            _entry(
                "QL401",
                "No flight in this log",
                "The log shows no flight. The vehicle did not fly, or the part with the flight is missing.",
                "Use a log with a flight of at least half a minute. If you did fly, fetch the whole file "
                "from the vehicle again.",
            ),
            _entry(
                "QL402",
                "The flight is too short",
                "A model and its check on validation data need more flight without gaps.",
                "Fly the manoeuvre for a minute, without landing in between. If you chose a part with "
                "--start-s or --end-s, choose a longer one.",
            ),
            _entry(
                "QL403",
                "This axis was poorly excited",
                "Noise and gusts make up most of the motion of the axis, not responses to commands. A "
                "number fitted to that motion would look fine and be wrong.",
                "Excite this axis: quick stick doublets for half a minute, or a system-ID chirp.",
                step="fly",
            ),
            _entry(
                "QL404",
                "The torque does not explain all of the motion",
                "The torque explains most of the motion, but not nearly all. The axis was weakly excited, "
                "or something other than torque moved it.",
                _ENOUGH,
                step="fly",
            ),
            _entry(
                "QL405",
                "The motors could not give the commanded torque",
                "For part of the flight a motor was at its limit, and the mixer reduced roll, pitch or yaw "
                "torque. A torque computed from what the motors did includes that, and nothing is lost. If "
                "only the command is known, the samples around it are left out.",
                "Fly smaller manoeuvres, or fly at a throttle nearer to the middle.",
            ),
            _entry(
                "QL406",
                "A system-identification run is in this flight",
                "The autopilot injected a known excitation, which does not depend on gusts or noise. The "
                "estimate uses the motion that follows from it, and leaves out the rest.",
                "Read only the axes that the run excited. The run does not identify the others.",
            ),
            _entry(
                "QL420",
                "The torque holds little more than one frequency",
                "One frequency shows one gain and one phase. Effectiveness, damping, lag and delay cannot "
                "be separated. With set-points, the interval covers every lag that motors have. Without "
                "set-points, a model error of 0.1 % becomes an error of 10 % in the effectiveness, so no "
                "number is given.",
                "Excite this axis at several frequencies. Fly a chirp, doublets of different lengths, or "
                "at least three sinusoids over two octaves.",
            ),
            _entry(
                "QL430",
                "A motor gives less thrust than the others",
                "In steady flight one motor gets a higher command than the others. Position and spin of "
                "this motor both fit the difference. The motor is weak, or its propeller is damaged or of "
                "the wrong type.",
                f"Check the propeller and the bearings of {THIS_MOTOR}. On the bench, compare its speed "
                "with the others at the same command. Calibrate the ESCs.",
                scope="vehicle",
            ),
            _entry(
                "QL431",
                "A motor lost thrust during the flight",
                "From one moment on, one motor got a higher command than before. Position and spin of this "
                "motor both fit the difference. Load and wind do not turn the vehicle like that.",
                f"Do not fly before you have checked {THIS_MOTOR}, its propeller and its ESC. Feel whether "
                "they are hot, and turn the motor by hand.",
                scope="vehicle",
            ),
            _entry(
                "QL432",
                "A propeller is out of balance",
                "The gyro vibrates more at the speed of one rotor than at the speeds of all others together.",
                f"Replace or balance the propeller of {THIS_MOTOR}. Then check the motor's shaft and mount.",
                scope="vehicle",
            ),
            _entry(
                "QL433",
                "A motor lost its thrust for a moment",
                "For about a tenth of a second the vehicle turned as if one rotor had lost half of its "
                "thrust or more. A desync of an ESC looks like that.",
                f"Check the wires, solder joints and ESC of {THIS_MOTOR}. If they are sound, raise the "
                "ESC's timing or start-up power, and its demag compensation.",
                scope="vehicle",
            ),
            _entry(
                "QL434",
                "The centre of mass is not in the middle of the rotors",
                "The rotors on one side carry more weight than those on the other side. If all rotors are "
                "alike, the centre of mass is on that side.",
                "If the motors of the two sides differ by more than normal, move the battery away from "
                "that side.",
                scope="vehicle",
            ),
            _entry(
                "QL435",
                "The accelerometer clipped",
                "The accelerometer was at the end of its range in more than 100 samples. The autopilot's "
                "attitude and height can be wrong then.",
                "Balance the propellers. Mount the flight controller more softly.",
                scope="vehicle",
            ),
            _entry(
                "QL436",
                "A motor stood still while it was commanded to turn",
                "One motor turned less than half as fast as the slowest other one, for a second or longer. "
                "Its command was above the mean of the others. If the vehicle flew well meanwhile, only "
                "the speed reading is wrong.",
                f"Take the propellers off and run each motor on the bench. If {THIS_MOTOR} does not turn, "
                "check its wires, solder joints, winding and ESC. If it turns, check the ESC's telemetry.",
                scope="vehicle",
            ),
            _entry(
                "QL437",
                "An axis turned against its set-points",
                "The vehicle turned one way while the rate controller commanded the other way, for longer "
                "than a loop may be late and by more than 45 degrees. The motors could not give the torque "
                "that this axis needs, turned it the wrong way, or gave it too slowly, as where the "
                "integrator has to learn a lasting torque first.",
                "Do not fly before you know why an axis turned against its set-points. For yaw, check that "
                "no motor and no arm is twisted, and how each motor turns. For roll and pitch, check motors, "
                "propellers and the load.",
                scope="vehicle",
            ),
            _entry(
                "QL501",
                "The windows of the published method hold mostly noise",
                "The published method solves each window of a few samples by itself. Consecutive samples "
                "differ by little more than noise, so the matrix H_k of such a window is nearly singular. "
                "The models of this report are fitted to all data at once and do not suffer from it.",
                "Use the model as it is. To see the published method at its best, try --sample-rate-hz 20 "
                "and a wider --window.",
            ),
            _entry(
                "QL503",
                "The estimate depends on the frequency band",
                "Slow and fast motion give different values of the control effectiveness. A rigid body has "
                "only one value. Noise, wind or the controller's feedback distorts at least one of them.",
                _ENOUGH,
                step="fly",
            ),
            _entry(
                "QL504",
                "The model fails on validation data",
                "The model predicts the acceleration badly on validation data, which the fit did not use. "
                "If air moved the vehicle as much as commands did, its response to commands is judged "
                "instead. No single effectiveness, lag and damping describe that response.",
                f"Do not use this axis. {_ENOUGH}",
                step="fly",
            ),
            _entry(
                "QL505",
                "The interval is too wide",
                "Very different values of the control effectiveness fit the data. If the ends of the "
                "interval differ by less than a factor of 3, the number is given with caution. It shows "
                "the order of magnitude only: comparisons and tuning do not use it. If they differ by "
                "more, no number is given. If only the response to commands shows it, no number is "
                "given beyond ±25 %.",
                f"Fly longer. {_ENOUGH}",
                step="fly",
            ),
            _entry(
                "QL506",
                "The control effectiveness has the wrong sign",
                "More torque would turn the vehicle the other way, which is impossible. The sign of a "
                "signal is wrong, or the controller's feedback was identified instead of the vehicle.",
                "Fly larger stick doublets on this axis. If the sign stays wrong, check the signs of a "
                "table's columns, or the mounting orientation of the flight controller.",
            ),
            _entry(
                "QL507",
                "The lag lies at the end of the searched range",
                "The best lag or delay lies at the end of the range that was tried. At the upper end it is "
                "not a motor's, and neither of them is identified. A delay of zero is the lower end: the "
                "true one cannot be told from zero.",
                "Check that torque and rates come from the same clock.",
            ),
            _entry(
                "QL509",
                "The control effectiveness differs between parts of the flight",
                "At one moment the effectiveness changed by more than chance allows. The vehicle changed "
                "(battery, payload, damage, a propeller), or something other than torque moved it. The "
                "interval covers the values before and after.",
                'Look at the figure "Window estimates over time". Analyze each part that is long enough '
                "by itself, with --start-s and --end-s.",
            ),
            _entry(
                "QL532",
                "The control effectiveness of both other axes changes in flight",
                "Battery, payload, propellers and loose parts change the effectiveness of all axes. This "
                "axis shows only one value, perhaps because it was commanded in only one part of the "
                "flight.",
                "Command this axis throughout the flight. Find out what changes the other two.",
            ),
            _entry(
                "QL511",
                "The torque alone does not reproduce the motion",
                "The rate was simulated over seconds from the logged torque, with the other two rates as "
                "measured. It differs from the measured rate. Wind or an imbalance moved the vehicle, and "
                "much of the torque is the controller's answer to that. An effectiveness fitted to such an "
                "answer is biased, even if the fit looks good. An unstable model is simulated only for as "
                "long as its motion can be predicted.",
                _ENOUGH,
                step="fly",
            ),
            _entry(
                "QL510",
                "The torque is a normalised command",
                "The log holds no torque in N m. The effectiveness is per unit of command, and no inertia "
                "in kg m^2 can be given.",
                "For physical units, describe the vehicle with --vehicle FILE.toml.",
            ),
            _entry(
                "QL515",
                "Real torque per commanded torque, by the inertia that was given",
                "The effectiveness times the given moment of inertia is the ratio of real to commanded "
                "torque, if that inertia is right. The ratio calibrates the torque. It is not an inertia "
                "measured in flight.",
                "Use the ratio to correct the commanded torque. A refused axis has no ratio.",
            ),
            _entry(
                "QL516",
                "This log shows the controller reacting to disturbances, not the vehicle reacting to the "
                "controller",
                "Gusts or noise moved the vehicle, the controller answered, and the log shows the "
                "controller's gains: -1/C, the inverse of the controller. In the band that holds most of "
                "the torque, the response of acceleration to torque grows with frequency. Its phase is "
                "that of a growing response with the sign reversed (near -90 degrees if it grows in "
                "proportion). No vehicle responds like that. A higher band or a longer hover would show "
                "the same, with more confidence.",
                "Move the sticks more on this axis, so that commands move the vehicle more than air and "
                "noise do.",
                step="fly",
            ),
            _entry(
                "QL520",
                "The torque was computed from the rates",
                "The rates follow the torque without any lag, and fast changes of the torque have their "
                "full effect. Real motors lag, and a gyro's filter delays. This torque is a derivative of "
                "the rates. Its effectiveness repeats what was assumed when it was computed. If roll or "
                "pitch shows it, no axis is judged.",
                "Log the torque that was commanded, or the motor outputs.",
            ),
            _entry(
                "QL521",
                "The torque leads to a rate, not to an acceleration",
                "A constant torque would turn the vehicle at a constant rate within a fraction of a "
                "second. Air does not damp a multirotor like that, but a rate controller does. What is "
                "logged as torque is the controller's input, or a set-point.",
                "Log the output of the rate controller, not its input.",
            ),
            _entry(
                "QL522",
                "The torque is stamped after the motion that it causes",
                "The model fits best with the torque of a later time stamp. The clocks of torque and rates "
                "differ, or the rates were smoothed in both directions. Lag and effectiveness are then "
                "biased low. The interval also covers the effectiveness that fits with the torque moved in "
                "time.",
                "Take torque and rates from one clock. Stamp each sample with the time at which it "
                "applied, not at which it was written.",
            ),
            _entry(
                "QL523",
                "Small torques have less effect",
                "Below some torque, or some change of a rotor's command, the vehicle responds less than "
                "above. The cause is a dead zone, friction, or coarse steps of the outputs. The "
                "effectiveness then depends on the size of the manoeuvre. The interval covers the "
                "effectiveness outside the dead zone.",
                "Look for a dead band in the mixer or the ESCs. Fly manoeuvres well above it: they show "
                "the full effectiveness of this axis.",
            ),
            _entry(
                "QL524",
                "Large torques have less effect",
                "Above some torque, more command adds hardly any motion. The outputs are limited, and the "
                "log does not show it. Small torques have a higher effectiveness than the estimate. The "
                "interval covers that where it can.",
                "Log the motor outputs as fast as the torque. If you cannot, keep the manoeuvres of this "
                "axis below the limit.",
            ),
            _entry(
                "QL525",
                "The response has a resonance",
                "Near one frequency the rates respond like something that bends or swings: an arm, a soft "
                "gyro mount, a load. A rigid body does not do that. The effectiveness then depends on the "
                "frequency band.",
                "Stiffen what bends, or put a notch at its frequency. Do not raise gains.",
            ),
            _entry(
                "QL526",
                "A moment that grows with the tilt turns the vehicle",
                "The vehicle's own tilt turns it. The cause is a pendulum below the centre of mass, a "
                "sling load, or a shape that is unstable in its own airflow. The model leaves this moment "
                "out. The interval is wide enough to allow for it.",
                "Fly quicker manoeuvres without load, or leave out slow motion with --band LOW HIGH.",
            ),
            _entry(
                "QL527",
                "The motors do not respond with a single lag",
                "The torque does not build up like that of one first-order lag. Rotors spin down more "
                "slowly than up, or another filter lies in between. The interval is wide enough to allow "
                "for that.",
                "If they are missing, log the motor outputs and describe the rotors with --vehicle "
                "FILE.toml.",
            ),
            _entry(
                "QL528",
                "The control effectiveness varies in flight",
                "The thrust per command varies (battery, throttle, ground, another controller), or "
                "something other than torque moves the vehicle. The residual persists from one half second "
                "to the next, or grows and shrinks with the modelled motion. Noise does neither.",
                'Look at the figure "Window estimates over time". Fly the manoeuvre at one throttle, far '
                "from the ground.",
            ),
            _entry(
                "QL529",
                "The flights are not of one vehicle in one state",
                "Each flight was fitted by itself. The values of the control effectiveness differ by more "
                "than their intervals allow. The common value describes none of the flights.",
                "Analyze each flight by itself: leave --pool out, or use --start-s and --end-s.",
            ),
            _entry(
                "QL530",
                "The thrust curve is not the one that the autopilot assumes",
                "The effectiveness changes with thrust, so the expo of the thrust curve differs from the "
                "parameter. The torque was computed with the expo that fits. The effectiveness therefore "
                "holds at the mean thrust of the manoeuvre. With the autopilot's expo, the loop gain "
                "changes with throttle.",
                "Set the expo of the thrust curve to the value found. Then check the tuning with small "
                "inputs.",
            ),
            _entry(
                "QL531",
                "Yaw was identified from a slow log",
                "Rates and torque were logged too slowly for roll and pitch. Yaw is slow enough: its "
                "response to set-points from 0.3 to 2.5 Hz gives its effectiveness. The interval allows 5 "
                "% for what happened between the samples. Gusts move the vehicle as much as its commands "
                "do, so validation data cannot confirm the value.",
                "Compare this yaw value only with flights that were logged alike. For a model that can be "
                "confirmed, log faster.",
            ),
            _entry(
                "QL533",
                "The log does not rule out a dead zone or a limit that changes the effectiveness",
                "The flight hints at a dead zone or a limit that is not logged. The evidence is too weak "
                "to exclude chance. The effect would change the effectiveness by more than a tenth. The "
                "interval covers that.",
                "Fly the manoeuvre once more, for twice as long. Fly half of it gently and half of it with "
                "strong commands. Chance then averages out, and a real effect becomes clear.",
            ),
            _entry(
                "QL534",
                "The torque was logged in coarse steps",
                "The logged torque takes whole steps only. If it was rounded, the effectiveness is right. "
                "If it was cut toward zero, as a cast to whole numbers does, the torque is too small and "
                "the effectiveness too high. Where the commands show that it was cut, the missing part is "
                "put back. Elsewhere the interval covers both.",
                "Log the torque with more digits, and fly the manoeuvre with larger commands.",
            ),
            _entry(
                "QL535",
                "The effectiveness comes from the response to commands alone",
                "Gusts moved this axis as much as its commands did, or an effect of rotors or logging "
                "makes a sample-by-sample fit too low. Gusts do not change the commands. The response to "
                "commands therefore still gives effectiveness, damping and lag. It is taken from spectra "
                "of short segments: frequencies with less gust count more. Dead zones, limits and other "
                "effects are corrected where the flight shows them. Where the flight leaves them open, the "
                "interval covers them. Pooled flights may repeat one trajectory with a logged velocity. "
                "What they have in common then counts as the command.",
                "For a narrower interval, fly in calmer air, or make larger and quicker manoeuvres.",
                step="fly",
            ),
            _entry(
                "QL536",
                "The vehicle's balance moved in flight: a motor may have lost thrust",
                "The thrust that holds the vehicle level moved to another place during the flight. A load "
                "that slips does that, and so does a motor that loses thrust. A motor that gives less "
                "lowers the effectiveness of the axes that it turns. The evidence gives the effectiveness "
                "afterwards as a fraction of that before. The interval holds both.",
                "Before the next flight, check the motors, the propellers and the load. For a narrower "
                "interval, analyze the flight before and after the change separately, with --start-s and "
                "--end-s.",
            ),
            _entry(
                "QL512",
                "The inertia is implausible for a multirotor",
                "The largest moment of inertia of a body is at most the sum of the other two. Mass times "
                "the square of the arm also bounds the moments of a multirotor. The result breaks these "
                "bounds by more than its interval. The mass, arm, thrust or torque-to-thrust ratio that "
                "was used is not this vehicle's.",
                "Check the numbers in the vehicle file. Compare them with the figure of the airframe.",
            ),
            _entry(
                "QL601",
                "The control loop has little margin",
                "A good loop keeps 6 dB, 45 degrees and a disk margin of 0.67 with 97.5 % confidence. "
                "Below 4 dB or 30 degrees a loop is close to instability. A lighter vehicle, a fuller "
                "battery or a little more delay can then make it oscillate. Gains that are too high cost "
                "margin, and so can gains that are too low.",
                "Run `quadid-log tune LOG`: it computes the next gains, or says why it cannot.",
                scope="loop",
            ),
            _entry(
                "QL602",
                "The open-loop and the closed-loop estimate of the effectiveness disagree",
                "Model and controller were simulated from the set-points. They reproduce the measured "
                "torque only with another control effectiveness than the one identified from torque and "
                "rates. One of the two is biased. The controller is not that of the parameters, or "
                "something other than torque moved the vehicle.",
                "Check that no gain was changed in flight. Fly the manoeuvres of this axis again, in calm "
                "air.",
            ),
            _entry(
                "QL603",
                "The measured response contradicts the model around the crossover",
                "The loop's stability is decided around the crossover frequency. There, the measured "
                "response of the rate to the torque differs from the model's. The model holds at the lower "
                "frequencies where it was fitted. The margins depend on the higher ones.",
                "Do not rely on the margins of this axis. Fly a system-ID chirp up to twice the crossover: "
                "it shows the loop itself.",
                scope="loop",
            ),
            _entry(
                "QL604",
                "The controller reconstructed from the logged parameters does not reproduce the logged "
                "output",
                "The controller was replayed from logged set-points and rates. It does not give the logged "
                "terms and torque, so its loop is not judged.",
                "Keep the gains as they are during the flight. Log the controller's terms at the loop rate.",
                scope="loop",
            ),
            _entry(
                "QL605",
                "The margins rest on frequencies that were not measured",
                "The loop's stability depends on frequencies above those that the flight shows. Something "
                "unmeasured may take phase there: the margins' intervals allow for a low-pass of up to 9 "
                "degrees. A bending frame may add gain there: the intervals allow for the modes that the "
                "log does not rule out.",
                "Fly a system-ID chirp up to twice the crossover, or quicker manoeuvres.",
                scope="loop",
            ),
            _entry(
                "QL606",
                "The control law is that of another firmware version",
                "This tool does not know the control law of this firmware version. It used the law of the "
                "nearest version that it knows.",
                "Look in the firmware's release notes for changes of the rate controller between the two "
                "versions.",
                scope="loop",
            ),
            _entry(
                "QL607",
                "A peak above the fitted band limits the gain margin",
                "The spectrum of the rate has a peak there, strong or weak: an arm, a mount or a load "
                "bends, or a propeller shakes. What bends adds gain to the loop. The gain margin and its "
                "interval allow for it. A log that is slower than the loop may show faster vibration "
                "there, such as that of a propeller's blades.",
                "Look for what bends or is loose, and stiffen it. Or put a notch at that frequency, if a "
                "log at the loop rate shows the peak too. Do not raise P or D before that.",
                scope="loop",
            ),
            _entry(
                "QL650",
                "The attitude controller reconstructed from the logged parameters does not reproduce the "
                "logged rate set-points",
                "The attitude controller was replayed from logged attitudes and their set-points. It does "
                "not give the logged rate set-points. The margins with the angle loop then hold for "
                "another gain. No margins of the velocity loop are given.",
                "Check that no gain of the attitude controller was changed in flight, and fly once more.",
                scope="loop",
            ),
            _entry(
                "QL651",
                "The position or velocity controller reconstructed from the logged parameters does not "
                "reproduce the logged targets",
                "The controllers were replayed from logged positions, velocities and their set-points. "
                "They do not give the logged targets: the gain that fits differs from the logged one by "
                "more than 10 %. Some firmware lowers these gains by itself, for example with optical "
                "flow. A flight at the limit of tilt or speed looks the same. No margin of the velocity "
                "loop is given.",
                "Check that no gain of these controllers was changed in flight. Fly once more in calm air.",
                scope="loop",
            ),
            _entry(
                "QL652",
                "The velocity loop is close to instability",
                "The velocity and position controllers leave a margin of less than 30 degrees or 4 dB. The "
                "vehicle then sways slowly, over some seconds, while it holds a position.",
                "Fly without velocity and position control until this is cleared. Compare the gains of the "
                "position and velocity controllers with the firmware's defaults.",
                scope="loop",
            ),
            _entry(
                "QL653",
                "The attitude responds too slowly for the velocity loop",
                "The bandwidth of the attitude is less than 2.5 times the crossover frequency of the "
                "velocity loop. The attitude then takes more than 22 degrees of phase from that loop.",
                "Tune the attitude before the velocity loop: run `quadid-log tune LOG`.",
                scope="loop",
            ),
            _entry(
                "QL654",
                "The vehicle did not follow its velocity set-point",
                "The velocity missed its set-point by more than the set-point itself moved. A vehicle that "
                "did not respond at all would have missed it by less. Wind, tilt limits or a swaying "
                "velocity loop cause that.",
                "Check the tilt limit, and the wind of that flight.",
                scope="loop",
            ),
            _entry(
                "QL655",
                "No margins of the velocity and position loops are given",
                "The log holds messages of the position controller, but these loops cannot be closed "
                "around the model. A gain is unknown, the rows are too few or too slow, or the attitude "
                "loop inside is not known well enough.",
                "Log all parameters, and fly manoeuvres that make roll and pitch usable.",
                scope="loop",
            ),
            _entry(
                "QL610",
                "No gains are recommended for this vehicle",
                "Gains are recommended only for multirotors with a rate controller that this tool knows. "
                "This is another autopilot, or a vehicle that also flies as something else.",
                "Tune it by its own autopilot's instructions.",
                scope="gains",
            ),
            _entry(
                "QL611",
                "The controller cannot be reconstructed from the logged parameters",
                "Parameters of the rate controller are missing in the log, are not numbers, or switch on "
                "something that is not modelled.",
                "Log all parameters, and fly with the standard rate controller.",
                step="set",
                scope="gains",
            ),
            _entry(
                "QL612",
                "The controller reconstructed from the logged parameters does not reproduce the logged "
                "output",
                "The controller was replayed from logged set-points and rates. It does not give the logged "
                "terms and torque. Gains computed for it would suit another controller.",
                "Read under QL604 what differs. Fly once more with gains that stay as they are.",
                scope="gains",
            ),
            _entry(
                "QL613",
                "The controller could not be checked against the log",
                "The controller cannot be replayed: set-points, rates and torque were logged too slowly, "
                "or the clock was reset. No gain is changed without that check.",
                "Log rates, set-points and the controller's output at the loop rate, and fly once more.",
                step="set",
                scope="gains",
            ),
            _entry(
                "QL614",
                "The measured response contradicts the model at the crossover",
                "The loop's stability is decided around the crossover frequency. There, the measured "
                "response differs from the model's (QL603).",
                "Fly a system-ID chirp up to twice the crossover, and tune from that flight.",
                scope="gains",
            ),
            _entry(
                "QL615",
                "The model of this axis is not usable",
                "Gains follow from the model. The findings that are listed with the axis say why this "
                "model cannot be trusted.",
                "Take the next steps that `quadid-log analyze LOG` prints. Then tune from the new flight.",
                scope="gains",
            ),
            _entry(
                "QL616",
                "The slew limiter scaled the gains down",
                "The slew limiter scaled P and D down in flight, or it may have done so and the log does "
                "not show it. The gains of the parameters are then not those that flew.",
                "Log the controller's terms: they show how often the limiter acted. Fly so gently that it "
                "stays out, and tune from that flight.",
                scope="gains",
            ),
            _entry(
                "QL617",
                "The mixer was at its limits",
                "This axis got less torque than was commanded in more than a tenth of the flight. Other "
                "gains do not change that, and higher ones would only reach the limits sooner. Gains are "
                "only lowered, and only if they leave too little margin.",
                "Fly gentler manoeuvres, or use a lighter vehicle or stronger motors.",
                scope="gains",
            ),
            _entry(
                "QL618",
                "The model is too uncertain to change gains",
                "With the estimated model, the margins meet their limits. In the worst case within the "
                "intervals of effectiveness, lag and delay, the loop is close to instability. Other gains "
                "may help or harm.",
                "Fly stronger manoeuvres for longer, in calm air, with fast logging.",
                scope="gains",
            ),
            _entry(
                "QL619",
                "Part of the vehicle bends or swings",
                "The model's residual shows a flexible mode (QL525): an arm, a damper or a payload. Gains "
                "that suit the model may excite it.",
                "Stiffen what bends, or put a notch at its frequency. Then fly once more.",
                scope="gains",
            ),
            _entry(
                "QL620",
                "The phase of a notch is not known",
                "A notch follows a frequency that neither the parameters nor the log hold. The body rates "
                "were logged before this notch, so its phase is missing in the margins.",
                "Log the body rates behind the filters, or log what the notch follows. Or fix the notch at "
                "one frequency, fly once more, and tune from that flight.",
                step="set",
                scope="gains",
            ),
            _entry(
                "QL621",
                "The firmware version that flew is unknown",
                "The log does not say which version of the control law flew.",
                "Fly with a current firmware: it writes its version into the log.",
                step="set",
                scope="gains",
            ),
            _entry(
                "QL622",
                "The gains were changed after the part that was analyzed",
                "The vehicle no longer has the gains that flew here. A change computed from them would be "
                "wrong.",
                "Tune from a flight with the gains that are set now.",
                scope="gains",
            ),
            _entry(
                "QL623",
                "This model was fitted to several logs",
                "The logs may be of several vehicles, or flown with several sets of gains.",
                "Tune from one flight.",
                scope="gains",
            ),
            _entry(
                "QL626",
                "This flight and an earlier one do not fit one vehicle",
                "The models of this axis from the two flights differ by more than their intervals and the "
                "typical difference between flights allow. Something changed, or one of the flights "
                "misleads.",
                "Look for what changed. If something did, leave out the earlier flights. If nothing did, "
                "fly the manoeuvre once more.",
                scope="gains",
            ),
            _entry(
                "QL627",
                "This flight shows too little of this axis: the gains follow from earlier flights",
                "No model of this axis can be identified from this flight. Nothing in it contradicts the "
                "model of earlier flights. The intervals are those of the earlier flights, widened by the "
                "typical difference between flights.",
                "Load the file, and heed the warning beside these gains. For narrower intervals, fly "
                "stronger manoeuvres on this axis, or fly in calmer air. Give all of these logs with "
                "`--earlier` when you tune from the next one.",
                scope="gains",
            ),
            _entry(
                "QL624",
                "No common factor of P, I and D brings the margins to their limits",
                "Neither higher nor lower gains meet the margin limits. Filters, angle loop or motors take "
                "too much phase.",
                "Keep the gains. If a filter limits this axis, QL636 names it and its cut-off.",
                scope="gains",
            ),
            _entry(
                "QL625",
                "There is no stable loop to start from",
                "With the flown gains, the loop around the model is not known, or it is unstable although "
                "the vehicle flew. Gains or model are not those of this flight.",
                "Read the findings about the loop, and follow their advice.",
                scope="gains",
            ),
            _entry(
                "QL630",
                "Lower these gains: they leave too little margin for the next flight",
                "In the worst case expected on the next flight, the flown gains leave less margin than "
                "required. Lower gains leave more.",
                "Load the file, hover first, and heed the warning beside these gains.",
                scope="gains",
            ),
            _entry(
                "QL631",
                "Raise these gains: they reject gusts better, and margins stay above the limits",
                "Even in the worst case within the uncertainty of this flight, there is more margin than "
                "required.",
                "Load the file, hover first, and heed the warning beside these gains.",
                scope="gains",
            ),
            _entry(
                "QL660",
                "Raise these gains: they leave too little margin for the next flight",
                "The rate loop is so slow that the angle loop around it lacks phase. The flown gains leave "
                "less margin than required. Higher gains leave more.",
                "Load the file, hover first, and heed the warning beside these gains.",
                scope="gains",
            ),
            _entry(
                "QL632",
                "Gyro noise limits the gains",
                "With higher gains, gyro noise would move the motors by more than a twentieth of their "
                "range.",
                "Reduce vibration: balance the propellers, mount the autopilot softly, and put notches at "
                "the motors' speeds.",
                scope="gains",
            ),
            _entry(
                "QL633",
                "One step at a time",
                "The gains reach their target over several flights. Above the crossover, the controller's "
                "response at most doubles from flight to flight. No margin falls below the limits.",
                "Fly the gains of the file, and tune again from that flight.",
                scope="gains",
            ),
            _entry(
                "QL634",
                "The gains are right as they are",
                "No change of more than a few per cent would be worth a flight.",
                "Keep the gains.",
                scope="gains",
            ),
            _entry(
                "QL635",
                "Motor limits cap the gains",
                "This axis got less torque than was commanded in more than a twentieth of the flight. "
                "Higher gains would only reach the limits sooner, and this flight does not show whether the "
                "flown ones are right.",
                "Fly gentler manoeuvres for tuning.",
                scope="gains",
            ),
            _entry(
                "QL636",
                "A filter, not the gain, limits this vehicle",
                "The delay of a low-pass takes most of the phase. With a higher cut-off the same gains "
                "would keep more margin, at the price of more noise.",
                "Raise the cut-off in small steps if vibration allows it, and tune again.",
                scope="gains",
            ),
            _entry(
                "QL637",
                "The documented range limits the gains",
                "The firmware documents no higher value of this parameter.",
                "Keep the value, or read the firmware's documentation of it.",
                scope="gains",
            ),
            _entry(
                "QL638",
                "No common factor of P, I and D reaches the required margins",
                "The recommended gains come closer to the required margins than the flown ones. Filters, "
                "angle loop or motors take the rest.",
                "If a filter limits this axis, QL636 names it and its cut-off.",
                scope="gains",
            ),
            _entry(
                "QL639",
                "The promise rests on frequencies that were not measured",
                "The promised margins depend on frequencies above those that the flight shows. They allow "
                "for a low-pass there that takes up to 9 degrees, and for modes of the frame that the log "
                "does not rule out.",
                "For a narrower promise, fly a system-ID chirp up to twice the crossover.",
                scope="gains",
            ),
            _entry(
                "QL670",
                "Change filters and gains together: they reject gusts better or make less noise, and "
                "margins stay above the limits",
                "A filter costs phase, and lost phase limits the gains. These filters and gains together "
                "leave less gust error or less noise on the motors than the best gains with the flown "
                "filters, and more of neither.",
                "Load the file as a whole: these gains belong to these filters. Hover first. Land after "
                "half a minute and feel the motors: they must be cool.",
                scope="gains",
            ),
            _entry(
                "QL671",
                "There is too much filtering",
                "A low-pass has a lower cut-off than the noise of this gyro requires. It costs phase for "
                "nothing.",
                "Set the cut-off as in the file, together with its gains.",
                scope="gains",
            ),
            _entry(
                "QL672",
                "There is too little filtering",
                "The low-pass lets too much noise through to the motors. The phase that it saves is not "
                "worth that.",
                "Set the cut-off as in the file, together with its gains.",
                scope="gains",
            ),
            _entry(
                "QL673",
                "The notches miss the vibration lines of the gyro",
                "A notch that misses its line costs phase for nothing. A line without a notch shakes the "
                "motors.",
                "Set the notches as in the file, and restart the autopilot before the flight.",
                scope="gains",
            ),
            _entry(
                "QL674",
                "The filters stay as they flew",
                "Other filters are recommended only if they help. No axis may end with more gust error or "
                "noise than with new gains alone, and all axes together must gain a tenth. No setting that "
                "was tried does that. Or all axes share the filters and one of them has no model. Or a "
                "notch follows a frequency that the log does not hold.",
                "Load the gains. Leave the filters as they are.",
                scope="gains",
            ),
            _entry(
                "QL675",
                "Off-nominal margins break a limit",
                "With another battery, load, air or propeller, the same command turns the vehicle more or "
                "less. In the named conditions, the worst case within the uncertainty of this flight falls "
                "below the limits. The gains are not lowered for that alone.",
                "Fly in the conditions of this flight, or tune again from a flight in the named condition.",
                scope="gains",
            ),
            _entry(
                "QL676",
                "A gain lies below its documented range",
                "The margins require a lower value of this gain than this firmware version documents. The "
                "firmware accepts it. A ground station may ask you to confirm it.",
                "Load the value, and confirm it if the ground station asks.",
                scope="gains",
            ),
            _entry(
                "QL641",
                "P, I, D and the angle gain change by different factors",
                "Each gain is set to the value that rejects gusts best. Margins are kept, noise stays "
                "acceptable, and the attitude follows its set-point no more slowly. One common factor on "
                "P, I and D would do worse.",
                "Load the file, hover first, and heed the warning beside these gains.",
                scope="gains",
            ),
            _entry(
                "QL643",
                "An angle loop that is not modelled flew around the rate loop",
                "In a self-levelling mode the angle loop takes phase from the rate loop. This log does not "
                "show how it computes rates from angles, so no gains are recommended from such a flight.",
                "Fly the whole flight in a mode in which the sticks command rates, and tune from that.",
                scope="gains",
            ),
            _entry(
                "QL644",
                "The log's rounding hides the controller",
                "Rates, set-points and terms are logged as whole numbers. In this calm flight they hardly "
                "rise above their rounding, so they neither confirm nor contradict the controller. No gain "
                "is changed without that check.",
                "Fly quick manoeuvres. Log with a higher resolution if the autopilot can.",
                scope="gains",
            ),
            _entry(
                "QL642",
                "Some terms of the controller were not replayed",
                "P, and D if the log is fast enough, were recomputed from set-points and rates, and agree "
                "with the log. The named terms were taken as logged: moving sticks, limits and throttle "
                "change them in ways that the log does not show. The margins use the gains of the "
                "settings. They hold for sticks at rest.",
                "To replay D as well, log at 1 kHz or more.",
                scope="loop",
            ),
            _entry(
                "QL640",
                "The log does not show the noise of the command",
                "The torque was logged too slowly to show what gyro noise does to it, so the gains are not "
                "raised.",
                "Log the controller's output at the loop rate.",
                scope="gains",
            ),
            _entry(
                "QL646",
                "This flight does not show whether other gains would be better",
                "With the estimated model, the margins meet their limits. In the worst case expected on "
                "the next flight, they do not. The intervals are too wide to raise the gains, and give no "
                "reason to lower them.",
                "Keep the gains. For narrower intervals, fly the manoeuvre again, longer and in calmer "
                "air. Give this log with `--earlier` when you tune from the next one.",
                scope="gains",
            ),
            _entry(
                "QL647",
                "A more precise model would allow better gains",
                "If the vehicle were exactly as estimated, other gains would reject gusts better by a "
                "quarter or more. In the worst case expected on the next flight, they would not keep the "
                "margins.",
                "Keep the gains. To go further, fly longer, in calmer air, with manoeuvres that reach "
                "twice the crossover. Give this log with `--earlier` when you tune from the next one.",
                scope="gains",
            ),
            _entry(
                "QL648",
                "A first step by rule, for an axis that oscillates without a model",
                "No model of this axis can be trusted, and the axis oscillates without a command. A loop "
                "that oscillates is at its limit. Half of its gain is 6 dB away from that. No margin is "
                "promised.",
                "Load the file, hover low for a short time, and run tune on that log. If it still "
                "oscillates, halve again. If it feels sluggish, load the back file.",
                scope="gains",
            ),
            _entry(
                "QL649",
                "A first step by rule, for a vehicle whose command is full of noise",
                "No axis has a model that can be trusted, and noise above 40 Hz makes more than a tenth of "
                "the command's range. Cut-offs of low-pass filters are halved, and never go below the "
                "firmware's defaults. A notch goes to the line that matters most. No margin is promised.",
                "Load the file, hover low for a short time, and run tune on that log. If the vehicle "
                "wobbles, load the back file. Balance the propellers.",
                scope="gains",
            ),
            _entry(
                "QL645",
                "The log does not rule out that the frame bends",
                "A frame that bends above the fitted band would take gain margin. This log is too slow, "
                "too short or too noisy to show it. That is no reason to lower the gains, nor to raise "
                "them.",
                "Log rates and torque at 400 Hz or more, and fly for a minute. Or give this log with "
                "`--earlier` when you tune from the next one.",
                scope="gains",
            ),
        )
    )
)
