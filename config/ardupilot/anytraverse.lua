--[[
AnyTraverse on the autopilot: stops the rover when its companion computer is dead, and changes modes for it without
overriding a human. ArduPilot Rover 4.5 or newer.

When in a guarded mode, armed, the companion (component 191 of this vehicle) is silent for ATS_TIMEOUT, reports a
fault, or the obstacle feed that the autopilot avoids by is dead, the mode becomes HOLD and a text says why. By
itself this script arms nothing and resumes nothing: the only modes it sets are HOLD and, to brake, GUIDED, never
over MANUAL, RTL or a failsafe's. A fault in spite of which a human drives on (the companion says so) holds nobody;
its silence still does.

The companion asks for HOLD, AUTO and GUIDED by MAV_CMD_USER_5 (31014): id of its hold, expected mode, mode to set,
serial number, longest time to brake in s. HOLD is set where the expected mode stands, AUTO and GUIDED only out of
the HOLD that was set for that id, or for the companion's silence or fault, where its mode reason still stands and
nobody has commanded HOLD since.
A HOLD that a switch of the transmitter sets within ours changes nothing that a script could see. Answers: ACCEPTED;
TEMPORARILY_REJECTED, another mode stands, or, where HOLD is asked for, a human's HOLD; DENIED, the HOLD is a human's
now; FAILED; IN_PROGRESS, it brakes, and the last answer follows. A serial number counts once, a request for 1 s.

HOLD lets a rover roll. So where the companion tells a time to brake (0 to 4 s), AUTO becomes GUIDED first, in which
ArduPilot brakes and keeps its heading, and HOLD below 0.1 m/s or after that time. This script sends no target: with
one of zero speed ArduPilot would add the pilot's throttle. HOLD is set at once where GUIDED is refused, the rover is
a boat (it would loiter), or a target of somebody else's was seen in the last 5 s. A target or a mode that somebody
else commands meanwhile takes over, and nothing more is set. A loss of the companion brakes for the time told last.

Guiding: a companion that may drive round what is in the way asks for GUIDED out of AUTO and, in the end, for AUTO
again, by the same command with 65536 for the id; GUIDED out of GUIDED asks whether that is still the companion's.
It is answered IN_PROGRESS, and the last answer follows when guiding
ends: ACCEPTED, by the companion's own request or a HOLD of this script's; TEMPORARILY_REJECTED, somebody took over.
GUIDED is set only while armed, where the last heartbeat said that it guides (bit 28), targets can be heard, and none of
somebody else's was seen in the last 5 s; AUTO only out of the GUIDED that was set so and is nobody else's since.
A HOLD within brakes as out of AUTO: since that GUIDED has a target, HOLD is set and GUIDED entered anew, which has
none. It may expect the mode that guiding changed within the last second: the two may have crossed. The targets
(message 84) are the companion's, at 5 Hz or more. Where none comes for 0.7 s, or the rover is disarmed, this script
brakes and holds, even if heartbeats come, in each policy and where it is switched off: what it began, it ends. A target
that comes while it brakes ends that in HOLD. A mode, a target or GUIDED that somebody else commands takes over; where one
more target of the companion's came after theirs, GUIDED is entered anew, and a text asks for theirs again. A
HOLD that is asked for within a second of that is not set. A restart of scripting forgets that it guides, since GUIDED
may be a human's by then: AUTO is refused, HOLD is set at once, the companion's silence counts as in every GUIDED, and
without targets ArduPilot stops after 3 s by itself.

It acts only where the companion may: when the last policy that its heartbeat told is "hold". One that was heard in
policy hold and falls silent is a loss; in report, shadow or off its silence and its faults stop nobody, nor does
the feed. ATS_POLICY 1 has it act in report and shadow too, ATS_NEED 1 in every policy and without any.

The human's mode wins. A loss is held once: whoever then sets a guarded mode again, by transmitter or ground
station, is taken to have read the text: no hold until the companion was well for 5 s or the rover was disarmed.
A hold of this script's that outlasts its cause is said every 10 s, until somebody sets a mode or disarms.
On the wire a program's mode change looks like a person's: one that insists on AUTO by itself gets through too.

Install: copy this file to APM/scripts on the SD card; SCR_ENABLE 1; SCR_HEAP_SIZE 122880 or more;
SCR_VM_I_COUNT 10000 (the default) or more, since a flood of frames takes 7200; reboot. The parameters ATS_* are
there when it runs, "Policy hold: loss of companion will be held" (or the like) is its first text, said again when
the policy changes; without a companion it stays silent and harmless, unless ATS_NEED asks for one.
Test it on blocks: policy hold, in AUTO, armed, pull the companion's cable. The wheels stop.

| parameter   | default | unit | meaning                                                                           |
|-------------|---------|------|-----------------------------------------------------------------------------------|
| ATS_ENABLE  | 1       |      | 0: the script stops nobody and repeats no texts; it still sets what is asked for, |
|             |         |      | and stops whom it guides where no targets come                                    |
| ATS_TIMEOUT | 1.5     | s    | silence that counts as dead, 1.2 to 10. Heartbeats come once a second: below 2.1  |
|             |         |      | one that is lost stops the rover. 0.5 s more are 1 m more at 2 m/s                |
| ATS_MODES   | 33792   | bits | guarded modes, 2^mode added up: AUTO 1024 and GUIDED 32768, the default; FOLLOW   |
|             |         |      | 64, DOCK 256, CIRCLE 512. Bits of other modes count for nothing                   |
| ATS_NEED    | 0       |      | 1: a companion is demanded from the start, in every policy. No arming without it, |
|             |         |      | where arming checks are on; one never heard or switched off counts as dead. In a  |
|             |         |      | fault arming is refused, too: to arm for MANUAL then, set 0                       |
| ATS_FAULT   | 1       |      | 1: the companion's state "fault" holds too. 0: only its silence does              |
| ATS_PRX     | 0.5     | s    | obstacle feed dead so long holds, 0.1 to 10, after the 0.5 s that ArduPilot takes |
|             |         |      | to notice; 0: never. It must be in use: a proximity sensor is set up, and         |
|             |         |      | AVOID_ENABLE contains 2 or OA_TYPE is not 0, and it worked once since boot (or    |
|             |         |      | ATS_NEED is 1)                                                                    |
| ATS_ECHO    | 1       |      | 1: the companion's texts of severity ERROR or worse (calls, holds) are said again |
|             |         |      | as the autopilot's own, for ground stations that hide those of component 191      |
| ATS_RC      | 0       |      | 300 to 307: the switch with this RCn_OPTION, when high, switches the script off   |
| ATS_POLICY  | 0       |      | 1: acts in the policies report and shadow too, not only in hold; never in off     |

One that restarts is a loss, until it sees again. After a restart of scripting companion and policy are forgotten
until the next heartbeat: one that died meanwhile is not missed, unless ATS_NEED is 1.
A parameter that holds no number counts as its default. A newer file with more parameters wants a reboot, as does
every "table 191 is taken"; where that stays, another script of yours has this number.
While another script leaves it no room to hear all that it must, arming is refused, unless ATS_ENABLE is 0.
Restart of scripting with ATS_NEED 1, or while it is deaf: reboot before arming, ArduPilot 4.6 and older keep the old
refusal.
--]]

local KEY, PREFIX = 191, "ATS_" -- the table's key is ours among all scripts, and stored
local DEFAULT_MODES = 33792
local PARAMETERS = {
  { "ENABLE", 1 }, { "TIMEOUT", 1.5 }, { "MODES", DEFAULT_MODES }, { "NEED", 0 },
  { "FAULT", 1 }, { "PRX", 0.5 }, { "ECHO", 1 }, { "RC", 0 }, { "POLICY", 0 }, -- places are stored: append
}
local CYCLE_MS, LONGEST_MS = 100, 100000
local QUEUE, IDS = 20, 25 -- no script can ask for more ids, and so none writes past their end
local COMPANION = 191
local HEARTBEAT, SET_MODE, COMMAND_INT, COMMAND_LONG, STATUSTEXT = 0, 11, 75, 76, 253
local MODE_REQUEST = 31014
local STARTING, FAULT, OFF = 0, 5, 6 -- states, in the low byte of the heartbeat's custom_mode
local POLICIES = { [0] = "report", "shadow", "hold", "off" } -- in its bits 24 and 25
local REPORT, MAY_HOLD, SWITCHED_OFF = 0, 2, 3
local HOLD, GUIDED = 4, 15
local GUARDABLE = { [6] = "FOLLOW", [8] = "DOCK", [9] = "CIRCLE", [10] = "AUTO", [15] = "GUIDED" }
local BY_SCRIPT = 32
local BY_HUMAN = { [1] = true, [2] = true, [42] = true, [53] = true } -- RC, GCS, FrSky, RC auxiliary switch
local ALERT, CRITICAL, ERROR, WARNING, INFO = 1, 2, 3, 4, 6
local TRIES = 3

local own_system, avoid, path_planner
local settings, defaults = {}, {}
local seen, watched, state, silent_ms = false, false, STARTING, 0
local policy, asked, guarding = REPORT, false, false
local fault_accepted, mode_ms, last_mode = false, 0, nil
local hold_id, hold_reason, pressed = nil, nil, false -- the companion's HOLD that stands; a human commanded HOLD within
local brake = { told_ms = 0, target_ms = 0 } -- the time to brake that was told; since a target was seen
-- Since a target of ours; since it set AUTO or GUIDED; since somebody's target took over.
local guide = { silent_ms = 0, changed_ms = LONGEST_MS, yield_ms = LONGEST_MS }
local running
local echoed_ms = LONGEST_MS
local failures, resorted = 0, false
local last = millis()

local function setting(name, low, high)
  local value = settings[name]:get()
  if not value or value ~= value then value = defaults[name] end
  return math.max(low, math.min(high, value))
end

local function is_on(name) return setting(name, 0, 1) >= 0.5 end

local function patience_ms() return 1000 * setting("TIMEOUT", 1.2, 10) end

local function later(ms, dt) return math.min(ms + dt, LONGEST_MS) end

-- Setting modes ----------------------------------------------------------------------------------------------------

local set_hold, hear_request, hear_target, go_on_braking
do
  local COMMAND_ACK, REMEMBERED, AUTO, BOAT = 77, 8, 10, 2
  local ACCEPTED, CHANGED, DENIED, FAILED, IN_PROGRESS = 0, 1, 2, 4, 5
  local RESUMABLE = { [10] = true, [15] = true }
  local LONGEST_BRAKE, STANDS, TARGET_MS = 4, 0.1, 5000 -- s, m/s
  local GUIDE_ID, LOST_MS, CROSSED_MS = 65536, 700, 1000 -- ids of holds have 16 bits
  local answered = {}

  local function answer(channel, serial, result)
    mavlink:send_chan(channel, COMMAND_ACK,
      string.pack("<HBBi4BB", MODE_REQUEST, result, 0, serial, own_system, COMPANION))
  end

  local function speed() -- 0 where it is not known
    local known, found = pcall(function() return ahrs:groundspeed_vector():length() end)
    return known and found or 0
  end

  local function may_brake()
    local boat = brake.frame_class and brake.frame_class:get() == BOAT
    return brake.told_ms > 0 and brake.target_ms >= TARGET_MS and not boat and speed() >= STANDS
  end

  local function answer_last(of, result) -- to a request that was answered IN_PROGRESS
    local serial = of.serial
    of.serial = nil
    if not serial then return end
    if answered[serial] then answered[serial] = result end
    answer(of.channel, serial, result)
  end

  local function end_brake(result)
    brake.left_ms = nil
    answer_last(brake, result)
  end

  local function end_guiding(result)
    guide.on = false
    answer_last(guide, result)
  end

  local function is_ours(mode) return vehicle:get_mode() == mode and vehicle:get_control_mode_reason() == BY_SCRIPT end

  -- Ends the braking in HOLD where the rover stands or the time is over, and as it is where somebody set a mode.
  function go_on_braking(dt)
    if not brake.left_ms then return end
    brake.left_ms = brake.left_ms - dt
    local over = brake.left_ms <= 0 or not (speed() >= STANDS) or not arming:is_armed()
    if not is_ours(GUIDED) then return end_brake(CHANGED) end
    if not over then return end
    vehicle:set_mode(HOLD)
    if is_ours(GUIDED) then return end -- it was refused: again in the next cycle
    if not is_ours(HOLD) then return end_brake(CHANGED) end -- a human was faster
    hold_id, hold_reason, pressed = brake.id, BY_SCRIPT, brake.pressed or false
    end_brake(ACCEPTED)
  end

  -- Whether guiding has lost its targets. It ends as it is where somebody set a mode.
  function guide.has_lost()
    if not guide.on then return false end
    if is_ours(GUIDED) then return guide.silent_ms > LOST_MS or not guide.asked or not arming:is_armed() end
    -- The companion's own HOLD may have gone past this script.
    local own = vehicle:get_mode() == HOLD and not pressed and vehicle:get_control_mode_reason() == hold_reason
    end_guiding(own and ACCEPTED or CHANGED)
    return false
  end

  -- A request and a change that guiding has just made may cross: then the mode before it may be the expected one.
  local function is_expected(mode, expected)
    if mode == expected then return true end
    local pair = mode == AUTO and expected == GUIDED or mode == GUIDED and expected == AUTO
    return pair and guide.changed_ms <= CROSSED_MS and is_ours(mode) and not brake.taken
  end

  -- The calls that compare and set stand side by side: nothing can hold the autopilot's loop between them.
  local function hold_or_brake(expected)
    local brakes = may_brake()
    local mode = vehicle:get_mode()
    if expected and not is_expected(mode, expected) then return CHANGED end
    local anew = brakes and guide.on and is_ours(GUIDED)
    local began = millis()
    if anew then
      vehicle:set_mode(HOLD) -- this GUIDED has a target, and one that is entered anew has none
      if not is_ours(HOLD) and not is_ours(GUIDED) then return CHANGED end -- a human was faster
      anew = is_ours(HOLD)
    end
    if anew or brakes and mode == AUTO then
      vehicle:set_mode(GUIDED)
      if is_ours(GUIDED) then
        brake.left_ms, brake.id, brake.began, brake.anew, brake.pressed = brake.told_ms, nil, began, anew, false
        return IN_PROGRESS
      end
      if vehicle:get_mode() ~= (anew and HOLD or AUTO) then return CHANGED end -- a human was faster
    end
    vehicle:set_mode(HOLD)
    if vehicle:get_mode() ~= HOLD then return FAILED end
    -- A human who was faster has set this HOLD.
    if vehicle:get_control_mode_reason() ~= BY_SCRIPT then return CHANGED end
    hold_id, hold_reason, pressed = nil, BY_SCRIPT, false
    return ACCEPTED
  end

  function set_hold(expected)
    if guide.on and not is_ours(GUIDED) then end_guiding(CHANGED) end
    local result = hold_or_brake(expected)
    if guide.on and (brake.left_ms or not is_ours(GUIDED)) then
      end_guiding(result == CHANGED and CHANGED or ACCEPTED)
    end
    return result
  end

  -- AUTO becomes GUIDED in which the companion's targets count, and such a GUIDED becomes AUTO.
  local function set_guiding(expected, mode)
    local ours = guide.on and is_ours(GUIDED)
    if mode == GUIDED and expected == GUIDED then return ours and IN_PROGRESS or CHANGED end -- it asks whether it is
    if mode == GUIDED and expected == AUTO then
      -- Where somebody else's targets come, or none would be heard, GUIDED would be theirs.
      if not guide.asked or silent_ms > patience_ms() or brake.target_ms < TARGET_MS then return FAILED end
      if ours then return IN_PROGRESS end
      if guide.on or vehicle:get_mode() ~= AUTO then return CHANGED end
      vehicle:set_mode(GUIDED)
      if is_ours(GUIDED) then
        guide.on, guide.silent_ms, guide.changed_ms = true, 0, 0
        return IN_PROGRESS
      end
      return vehicle:get_mode() == AUTO and FAILED or CHANGED
    end
    if mode ~= AUTO or expected ~= GUIDED then return FAILED end
    if not ours then return is_ours(AUTO) and ACCEPTED or CHANGED end -- the answer before may be lost
    vehicle:set_mode(AUTO)
    if is_ours(GUIDED) then return FAILED end -- it was refused
    local result = is_ours(AUTO) and ACCEPTED or CHANGED
    guide.changed_ms = 0
    end_guiding(result)
    return result
  end

  local function resume(mode)
    local now, reason = vehicle:get_mode(), vehicle:get_control_mode_reason()
    if now ~= HOLD then return CHANGED end
    if pressed or reason ~= hold_reason then return DENIED end
    return vehicle:set_mode(mode) and ACCEPTED or FAILED
  end

  local function set_requested(id, expected, mode)
    if not arming:is_armed() then return FAILED end
    if id == GUIDE_ID then return set_guiding(expected, mode) end
    if RESUMABLE[mode] then
      -- Without an id it is this script's own HOLD, for a loss that is over: the companion's did not reach it.
      if not hold_reason or hold_id and hold_id ~= id then return FAILED end
      return resume(mode)
    end
    if mode ~= HOLD then return FAILED end
    if guide.taken and mode_ms < CROSSED_MS then return CHANGED end -- it may have been asked for before that
    local result = ACCEPTED
    if brake.left_ms then
      brake.left_ms, result = math.min(brake.left_ms, brake.told_ms), IN_PROGRESS
    elseif vehicle:get_mode() ~= HOLD then
      result = set_hold(expected)
    elseif pressed or vehicle:get_control_mode_reason() ~= hold_reason then
      result = CHANGED
    end
    if result == ACCEPTED then hold_id = id end
    if result == IN_PROGRESS then brake.id = id end
    return result
  end

  function hear_request(content, channel)
    local id, expected, mode, serial, seconds = string.unpack("<fffff", content)
    if not (serial >= 1 and serial <= 0xFFFFFF and mode >= 0 and mode <= 255) then return end
    serial, mode = math.floor(serial), math.floor(mode)
    local result = answered[serial]
    if not result then
      brake.told_ms = seconds > 0 and math.floor(1000 * math.min(seconds, LONGEST_BRAKE)) or 0
      result = id == 0 and ACCEPTED or set_requested(id, expected, mode) -- 0 asks whether this script is there
      answered[serial] = result
      table.insert(answered, serial)
      if #answered > REMEMBERED then answered[table.remove(answered, 1)] = nil end
    end
    local job = id == GUIDE_ID and guide.on and guide or id ~= GUIDE_ID and brake.left_ms and brake
    if result == IN_PROGRESS and job then job.serial, job.channel = serial, channel end
    answer(channel, serial, result)
  end

  -- Whoever commands a target, or GUIDED, while this script brakes or guides has the rover: GUIDED is theirs now.
  function hear_target()
    brake.target_ms, brake.taken, mode_ms = 0, true, 0
    guide.taken = guide.taken or guide.on
    if guide.on then guide.yield_ms, guide.told = 0, false end
    end_brake(CHANGED)
    end_guiding(CHANGED)
  end

  -- One that the companion sent before it knew has replaced that of whoever took over. GUIDED that is entered anew has
  -- none, so that the rover does not drive on by it. Several may be on their way.
  function guide.yield()
    if not is_ours(GUIDED) then return end
    vehicle:set_mode(HOLD)
    if is_ours(HOLD) then vehicle:set_mode(GUIDED) end
    if not guide.told then gcs:send_text(WARNING, "GUIDED is yours: send the target again") end
    guide.told = true
  end

  -- One that comes while this script brakes makes the rover drive: HOLD at once.
  function guide.hear(age_ms, at)
    if not guide.on and not brake.left_ms then return guide.yield() end
    guide.silent_ms = age_ms
    if brake.left_ms and (at - brake.began):toint() > 0 then brake.left_ms = 0 end
  end
end

-- Listening --------------------------------------------------------------------------------------------------------

local register, listen
do
  local MAX_CHECKED = 4 -- checksums a cycle: they cost most of SCR_VM_I_COUNT
  local ONBOARD_CONTROLLER, DO_SET_MODE = 18, 176
  local CRC_EXTRA = { [HEARTBEAT] = 50, [SET_MODE] = 89, [COMMAND_INT] = 158, [COMMAND_LONG] = 152, [STATUSTEXT] = 83,
    [39] = 254, [73] = 38, [82] = 49, [84] = 143, [86] = 5 }
  local HEARD = { HEARTBEAT, COMMAND_LONG, SET_MODE, COMMAND_INT, STATUSTEXT } -- where places lack, the first ones
  local TARGETS = { [84] = 50, [86] = 50, [82] = 36, [39] = 32, [73] = 32 } -- messages; where they name their vehicle
  local LOCAL_TARGET, YIELD_MS = 84, 500
  local ITEMS, MOVES = { [39] = true, [73] = true }, { [192] = true, [213] = true } -- DO_REPOSITION, SET_YAW_SPEED
  local REQUEST_MS, MAX_WAITING = 1000, 8
  local BY_GCS = 2 -- a companion's own DO_SET_MODE counts as a ground station's
  local echoed = nil
  local requests = {} -- they wait until all is read: a human's HOLD may have come behind them

  local function checksum(bytes) -- CRC-16/MCRF4XX
    local sum = 0xFFFF
    for i = 1, #bytes do
      local byte = bytes:byte(i) ~ (sum & 0xFF)
      byte = (byte ~ (byte << 4)) & 0xFF
      sum = (sum >> 8) ~ (byte << 8) ~ (byte << 3) ~ (byte >> 4)
    end
    return sum
  end

  -- Frames that were damaged on the way reach scripts.
  local function payload(raw, start, id, system, component)
    local sum, magic, length, incompat, compat, seq = string.unpack("<I2BBBBB", raw)
    local sent
    if magic == 0xFE then
      sent = string.pack("<BBBBB", length, seq, system, component, id)
    elseif magic == 0xFD and incompat & 0xFE == 0 then
      sent = string.pack("<BBBBBBI3", length, incompat, compat, seq, system, component, id)
    else
      return nil
    end
    local content = raw:sub(start, start + length - 1)
    if checksum(sent .. content .. string.char(CRC_EXTRA[id])) ~= sum then return nil end
    return content .. string.rep("\0", 60 - #content) -- MAVLink 2 leaves out zeros at the end
  end

  local function hear_heartbeat(content, age_ms)
    local custom_mode, kind = string.unpack("<I4B", content)
    if kind ~= ONBOARD_CONTROLLER then return end
    local now = custom_mode & 0xFF
    -- One that starts has no eyes yet: after a crash it must not pass for the one that drove.
    if now == STARTING and (watched or is_on("NEED")) then return end
    seen, state, policy, silent_ms = true, now, custom_mode >> 24 & 3, age_ms
    fault_accepted, guide.asked = custom_mode >> 26 & 1 == 1, custom_mode >> 28 & 1 == 1
    watched = watched or now ~= STARTING
  end

  local function hear_text(content)
    local text = content:sub(2, 51)
    text = text:sub(1, (text:find("\0", 1, true) or 51) - 1):gsub("%c", " ")
    local again = text == echoed and echoed_ms < 2000 -- it came by two ways
    if text == "" or again or echoed_ms < 500 then return end
    echoed, echoed_ms = text, 0
    gcs:send_text(content:byte(1), text)
  end

  -- HOLD within HOLD changes neither mode nor reason: who commands it is known by the frame alone.
  local function hear_hold_command(content, ours)
    if not ours then
      pressed = true
      brake.pressed = brake.anew -- it may have come between the HOLD and the GUIDED that this brake began with
    elseif not pressed and vehicle:get_mode() == HOLD and vehicle:get_control_mode_reason() == BY_GCS then
      hold_id, hold_reason = string.unpack("<f", content, 25), BY_GCS
    end
  end

  -- What a frame of the ids that are registered is for, before its checksum is worth its time.
  local function purpose(raw, start, id, ours, echoes)
    if id == HEARTBEAT then return ours and "heartbeat" end
    if id == STATUSTEXT then return ours and echoes and raw:byte(start) <= ERROR and "text" end
    local others = (brake.left_ms or guide.on) and not ours
    if id == SET_MODE then
      local mode, target = string.unpack("<I4B", raw, start)
      if target ~= own_system and target ~= 0 then return nil end
      return others and mode == GUIDED and "target" or mode == HOLD and "hold command"
    end
    local place = TARGETS[id] or 30 -- both commands have it at one place
    local target = raw:byte(start + place)
    if target ~= own_system and target ~= 0 then return nil end
    if ours and id == LOCAL_TARGET then
      local counts = guide.on or brake.left_ms or guide.yield_ms < YIELD_MS
      return counts and not guide.checked and "own target"
    end
    local command = string.unpack("<H", raw, start + 28)
    local moves = MOVES[command]
    if TARGETS[id] then moves = not ITEMS[id] or raw:byte(start + 35) == 2 end -- 2: an item that is a target
    if moves and not ours and not others then brake.target_ms = 0 end -- seen is enough: no time for a checksum
    if moves or TARGETS[id] then return moves and others and "target" end
    if command == MODE_REQUEST then return ours and "request" end
    if command ~= DO_SET_MODE then return nil end
    local mode = string.unpack("<f", raw, start + 4)
    return others and mode == GUIDED and "target" or mode == HOLD and "hold command"
  end

  -- Another script's mavlink:init() wipes all registrations in ArduPilot 4.6; one that stands is left as it is.
  function register()
    local since = brake.target_ms
    brake.target_ms = 0 -- where targets find no place it does not brake, since it would not hear who takes over
    for _, id in ipairs(HEARD) do
      mavlink:register_rx_msgid(id)
    end
    local hears_targets = pcall(function()
      for id in pairs(TARGETS) do
        mavlink:register_rx_msgid(id)
      end
    end)
    if hears_targets then brake.target_ms = since end
  end

  function listen()
    guide.checked = false
    local echoes, patience, checked = is_on("ECHO") and is_on("ENABLE"), patience_ms(), 0
    for _ = 1, QUEUE do
      if checked == MAX_CHECKED then return end
      local raw, channel, at = mavlink:receive_chan()
      if not raw then break end
      -- A mavlink_message_t, as long as system ids had 8 bits (291 bytes) and since they may have 32 (299).
      local system, component, id, start = string.unpack(#raw >= 299 and "<I4BI3" or "<BBI3", raw, 8)
      local ours = system == own_system and component == COMPANION
      local what = purpose(raw, start, id, ours, echoes)
      local age_ms = what and (millis() - at):toint() or -1
      -- What waited longer than the time-out, as behind a restart of scripting, is no news.
      if age_ms >= 0 and age_ms <= (what == "request" and REQUEST_MS or patience) then
        -- A target of ours takes nobody's turn: one a cycle is checked beside the others.
        if what == "own target" then guide.checked = true else checked = checked + 1 end
        local content = payload(raw, start, id, system, component)
        if not content then what = nil end
        if what == "heartbeat" then hear_heartbeat(content, age_ms) end
        if what == "text" then hear_text(content) end
        if what == "request" and #requests < MAX_WAITING then table.insert(requests, { content, channel, at }) end
        if what == "hold command" then hear_hold_command(content, ours) end
        if what == "target" then hear_target() end
        if what == "own target" then guide.hear(age_ms, at) end
      end
    end
    local due = requests
    requests = {}
    for _, request in ipairs(due) do
      if (millis() - request[3]):toint() <= REQUEST_MS then hear_request(request[1], request[2]) end
    end
  end
end

-- Judging ----------------------------------------------------------------------------------------------------------

local watch_feed, is_hold_policy, guards, trouble, is_guarded, by_human
do
  local WORD_MS = 600 -- until the companion has said whether a human's mode accepts its fault
  local GOOD = 2 -- proximity:get_status()
  local feed_seen, feed_dead_ms = false, 0

  local function is_set(parameter, mask)
    local value = parameter and parameter:get() or 0
    return math.floor(value) & mask ~= 0
  end

  function watch_feed(dt)
    local in_use = proximity and proximity:num_sensors() > 0 and (is_set(avoid, 2) or is_set(path_planner, 0xFF))
    if not in_use or proximity:get_status() == GOOD then
      feed_seen, feed_dead_ms = in_use or false, 0
    elseif feed_seen or is_on("NEED") then
      feed_dead_ms = later(feed_dead_ms, dt)
    end
  end

  function by_human() return brake.taken or BY_HUMAN[vehicle:get_control_mode_reason()] end

  local function is_off() return state == OFF or policy == SWITCHED_OFF end

  function is_hold_policy() return seen and policy == MAY_HOLD and not is_off() end

  -- Whether the companion's loss is held: one that may not hold while it lives may not when it is dead.
  function guards()
    asked = is_on("NEED") or is_on("POLICY") and seen and not is_off()
    return asked or is_hold_policy()
  end

  function trouble()
    if not guarding then return nil end
    if not seen then return "no companion" end
    if is_off() then return "companion is off" end
    if silent_ms > patience_ms() then return "companion silent" end
    -- A human who drives on in spite of a fault: the companion says whether that counts, once it has heard of the mode.
    local waits = mode_ms < WORD_MS and by_human()
    local excused = state == FAULT and (fault_accepted or waits)
    -- A state that a later companion may know and this script does not is no reason to drive on.
    if is_on("FAULT") and (state == FAULT or state > OFF) and not excused then return "companion fault" end
    local patience = setting("PRX", 0, 10)
    if patience > 0 and feed_dead_ms > 1000 * patience then return "obstacle feed dead" end
  end

  function is_guarded(mode)
    local modes = math.floor(setting("MODES", 0, 65535))
    return GUARDABLE[mode] ~= nil and modes >> mode & 1 == 1
  end
end

-- Acting -----------------------------------------------------------------------------------------------------------

local tell, watch_mode, guard
do
  local RETRY_MS, STEADY_MS, STANDS_MS = 1000, 5000, 10000
  local STOPPED = "guiding stopped"
  local held, held_from, accepted, warned = false, nil, false, nil
  local stands = nil -- what the hold that still stands was for
  local tries, wait_ms, well_ms = 0, 0, 0
  local told_policy, told, told_ms = nil, nil, 0

  local function tell_policy()
    if not seen or policy == told_policy then return end
    told_policy = policy
    gcs:send_text(INFO, "Policy " .. POLICIES[policy] .. ": loss of companion "
      .. (guarding and "will be held" or "is not held"))
  end

  local allow_arming
  do
    local auth_id

    function allow_arming(reason)
      if not auth_id and reason then auth_id = arming:get_aux_auth_id() end
      if not auth_id then return end
      if reason then
        arming:set_aux_auth_failed(auth_id, reason)
      else
        arming:set_aux_auth_passed(auth_id)
      end
    end
  end

  -- A brake whose time is over stands no more for HOLD: it was refused.
  local function mode_now() return brake.left_ms and brake.left_ms > 0 and HOLD or vehicle:get_mode() end

  local function say_held(reason)
    if brake.left_ms then return CRITICAL, "Braking: " .. reason end
    return CRITICAL, "HOLD: " .. reason .. ". " .. held_from .. " again = go blind"
  end

  local function hold(reason, mode, dt)
    wait_ms = wait_ms - dt
    if wait_ms > 0 then return ALERT, "HOLD REFUSED, " .. reason .. ": take over" end
    local from = GUARDABLE[guide.on and 10 or mode] -- out of guiding the mission's mode drives on
    set_hold(nil)
    if mode_now() == HOLD then
      held, held_from, stands, tries, wait_ms = true, from, reason, 0, 0
      return say_held(reason)
    end
    tries = tries + 1
    if tries < TRIES then return nil end
    wait_ms = RETRY_MS
    return ALERT, "HOLD REFUSED, " .. reason .. ": take over"
  end

  -- What there is to say about this trouble, having done what can be done about it.
  local function answer(reason, dt)
    local mode = mode_now()
    if not arming:is_armed() then
      held, accepted, stands, tries, wait_ms = false, false, nil, 0, 0
    elseif not is_guarded(mode) then
      tries, wait_ms = 0, 0
      if mode ~= HOLD then stands = nil end
      held = held or mode == HOLD and stands == STOPPED
      if held and mode == HOLD then return say_held(reason) end
      if not held and warned ~= reason then
        warned = reason
        gcs:send_text(WARNING, reason .. ": guarded modes will be held")
      end
    elseif accepted or held and by_human() then
      accepted, stands = true, nil
      return WARNING, GUARDABLE[mode] .. " without companion" .. (mode == 15 and ": send target again" or "")
    else
      return hold(reason, mode, dt)
    end
  end

  local function is_running()
    local switch = math.floor(setting("RC", 0, 307))
    return is_on("ENABLE") and not (switch >= 300 and rc:get_aux_cached(switch) == 2)
  end

  function tell(dt, severity, text, every_ms)
    told_ms = later(told_ms, dt)
    if text and (text ~= told or told_ms >= (every_ms or severity == ALERT and 5000 or 30000)) then
      gcs:send_text(severity, text)
      told_ms = 0
    end
    told = text
  end

  function watch_mode(dt)
    local mode = vehicle:get_mode()
    mode_ms = mode == last_mode and later(mode_ms, dt) or 0
    if mode ~= last_mode then brake.taken, guide.taken = false, false end
    last_mode = mode
    if mode ~= HOLD then hold_id, hold_reason, pressed = nil, nil, false end
  end

  function guide.watch()
    if not guide.has_lost() then return end
    set_hold(nil)
    if mode_now() == HOLD then held_from, stands = GUARDABLE[10], STOPPED end -- else again in the next cycle
  end

  local function say_stands()
    if mode_now() ~= HOLD or not arming:is_armed() then stands = nil end
    if stands ~= STOPPED then
      return WARNING, stands and "HOLD since " .. stands .. ": set " .. held_from .. " by hand" or nil, STANDS_MS
    end
    return CRITICAL, brake.left_ms and "Braking: " .. STOPPED or "HOLD: " .. STOPPED .. ". AUTO drives on", STANDS_MS
  end

  -- What there is to say, having done what can be done.
  function guard(dt, hears)
    watch_feed(dt)
    local was_running = running
    running = is_running()
    guarding = running and guards()
    if not running then
      held, accepted, warned, tries, wait_ms = false, false, nil, 0, 0
      allow_arming(nil)
      if stands == STOPPED then return say_stands() end
      stands = nil
      return WARNING, was_running ~= nil and "Companion guard is off: ATS_ENABLE or switch" or nil
    end
    tell_policy()
    local reason = trouble()
    local demand = reason and is_on("NEED") and reason .. ": fix it or ATS_NEED 0"
    allow_arming(not hears and "anytraverse.lua cannot hear: see messages" or demand)
    well_ms = reason and 0 or later(well_ms, dt)
    if well_ms >= STEADY_MS then accepted = false end
    if reason then return answer(reason, dt) end
    if (held or warned) and state ~= FAULT then
      gcs:send_text(WARNING, "Companion is back: nothing resumes by itself")
    end
    held, warned, tries, wait_ms = false, nil, 0, 0
    if not stands then return nil end
    return say_stands()
  end
end

-- Running ----------------------------------------------------------------------------------------------------------

-- A script that cannot judge any more is as dead as the companion it watches.
local function last_resort()
  if resorted or running == false or not arming:is_armed() then return end
  pcall(guards) -- where parameters cannot be read, what they said last counts
  if not (asked or is_hold_policy()) then return end
  local mode = vehicle:get_mode()
  local knows, guarded = pcall(is_guarded, mode)
  if not knows then guarded = DEFAULT_MODES >> mode & 1 == 1 end
  if not guarded then return end
  vehicle:set_mode(HOLD)
  resorted = vehicle:get_mode() == HOLD
end

local function complain(dt, problem)
  pcall(tell, dt, ALERT, ("anytraverse.lua: " .. tostring(problem):gsub("^.*:%d+: ", "")):sub(1, 50))
end

local function update()
  local now = millis()
  local dt = (now - last):toint()
  last = now
  if dt < 0 or dt > LONGEST_MS then dt = LONGEST_MS end
  silent_ms, echoed_ms = later(silent_ms, dt), later(echoed_ms, dt)
  brake.target_ms = later(brake.target_ms, dt)
  guide.silent_ms, guide.changed_ms = later(guide.silent_ms, dt), later(guide.changed_ms, dt)
  guide.yield_ms = later(guide.yield_ms, dt)
  pcall(watch_mode, dt) -- before it listens: what a frame means depends on the mode
  local has_places, full = pcall(register)
  local hears, deaf = pcall(listen)
  pcall(guide.watch)
  pcall(go_on_braking, dt)
  local sound, severity, text, every_ms = pcall(guard, dt, hears and has_places)
  failures = sound and 0 or failures + 1
  if failures >= TRIES then pcall(last_resort) end
  if sound then resorted = false end
  if not sound then
    complain(dt, severity)
  elseif text or hears and has_places then
    pcall(tell, dt, severity, text, every_ms)
  else
    complain(dt, hears and full or deaf)
  end
  return update, CYCLE_MS
end

local function optional(name)
  local parameter = Parameter()
  return parameter:init(name) and parameter or nil
end

local function set_up()
  assert(param:add_table(KEY, PREFIX, #PARAMETERS), "table 191 is taken: reboot first")
  for i, row in ipairs(PARAMETERS) do
    assert(param:add_param(KEY, i, row[1], row[2]), "no room for ATS_" .. row[1])
    settings[row[1]], defaults[row[1]] = Parameter(PREFIX .. row[1]), row[2]
  end
  own_system = assert(param:get("MAV_SYSID") or param:get("SYSID_THISMAV"), "no system id")
  avoid, path_planner, brake.frame_class = optional("AVOID_ENABLE"), optional("OA_TYPE"), optional("FRAME_CLASS")
  -- Where another script was first, ArduPilot 4.6 would wipe its registrations, and could write past their end.
  if not pcall(mavlink.receive_chan, mavlink) then mavlink:init(QUEUE, IDS) end
  mavlink:register_rx_msgid(HEARTBEAT)
  mavlink:block_command(MODE_REQUEST) -- or the autopilot would answer it, too
end

-- Without its parameters or its ears it guards nothing: better not to drive at all than to believe it does.
local function broken(problem)
  local id = arming:get_aux_auth_id()
  local function refuse()
    if id then arming:set_aux_auth_failed(id, "anytraverse.lua failed: see messages") end
    complain(1000, problem)
    return refuse, 1000
  end
  return refuse()
end

local ready, problem = pcall(set_up)
if not ready then return broken(problem) end
return update, CYCLE_MS
