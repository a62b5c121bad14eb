-- Provides the ArduPilot scripting bindings that the shipped script uses, on top of a table of host functions.
-- Like the real ones they refuse a call without the colon and numbers out of range. Returns one script's sandbox.
local host = ...

local uint32 = {}
uint32.__index = uint32

local function boxed(value) return setmetatable({ value = value & 0xFFFFFFFF }, uint32) end

local function unboxed(value) return type(value) == "table" and value.value or math.floor(value) end

uint32.__add = function(a, b) return boxed(unboxed(a) + unboxed(b)) end
uint32.__sub = function(a, b) return boxed(unboxed(a) - unboxed(b)) end
uint32.__lt = function(a, b) return unboxed(a) < unboxed(b) end
uint32.__le = function(a, b) return unboxed(a) <= unboxed(b) end
uint32.__eq = function(a, b) return unboxed(a) == unboxed(b) end
uint32.__tostring = function(a) return tostring(a.value) end
function uint32:tofloat() return self.value + 0.0 end
-- ArduPilot's Lua has integers of 32 bits.
function uint32:toint() return self.value < 0x80000000 and self.value or self.value - 0x100000000 end

local function singleton(name, methods)
  local object = {}
  for method, call in pairs(methods) do
    object[method] = function(self, ...)
      if self ~= object then error(name .. ":" .. method .. " wants a colon", 2) end
      return call(...)
    end
  end
  return object
end

local function whole(value, low, high)
  if type(value) ~= "number" or math.tointeger(value) == nil or value < low or value > high then
    error("argument out of range", 3)
  end
  return math.tointeger(value)
end

local parameter = {}
parameter.__index = parameter
function parameter:init(name)
  self.name = host.parameter(name) ~= nil and name or nil
  return self.name ~= nil
end
function parameter:get() return self.name and host.parameter(self.name) end

local function new_parameter(name)
  local made = setmetatable({}, parameter)
  if name and not made:init(name) then error("invalid parameter " .. name, 2) end
  return made
end

return {
  assert = assert, error = error, ipairs = ipairs, math = math, next = next, pairs = pairs, pcall = pcall,
  string = string, table = table, tonumber = tonumber, tostring = tostring, type = type,
  uint32_t = function(value) return boxed(math.floor(value or 0)) end,
  millis = function() return boxed(host.millis()) end,
  Parameter = new_parameter,
  vehicle = singleton("vehicle", {
    get_mode = function() return host.mode() end,
    get_control_mode_reason = function() return host.mode_reason() end,
    set_mode = function(mode) return host.set_mode(whole(mode, 0, 255)) end,
  }),
  ahrs = singleton("ahrs", {
    groundspeed_vector = function()
      local speed = host.speed()
      return { length = function() return speed end }
    end,
  }),
  arming = singleton("arming", {
    is_armed = function() return host.is_armed() end,
    get_aux_auth_id = function() return host.get_auth() end,
    set_aux_auth_passed = function(id) host.set_auth(whole(id, 0, 255), nil) end,
    set_aux_auth_failed = function(id, why) host.set_auth(whole(id, 0, 255), why) end,
  }),
  gcs = singleton("gcs", {
    send_text = function(severity, text) host.send_text(whole(severity, 0, 7), tostring(text)) end,
  }),
  mavlink = singleton("mavlink", {
    init = function(depth, ids) host.open_queue(whole(depth, 0, 25), whole(ids, 0, 25)) end,
    register_rx_msgid = function(id) return host.register(whole(id, 0, 0xFFFFFF)) end,
    block_command = function(number) return host.block(whole(number, 0, 65535)) end,
    send_chan = function(channel, id, payload)
      return host.send(whole(channel, 0, 255), whole(id, 0, 0xFFFFFF), payload)
    end,
    receive_chan = function()
      local frame = host.receive()
      if frame then return frame[0], frame[1], boxed(frame[2]) end
    end,
  }),
  param = singleton("param", {
    add_table = function(key, prefix, size) return host.add_table(whole(key, 1, 200), prefix, size) end,
    add_param = function(key, index, name, default) return host.add_parameter(key, index, name, default) end,
    get = function(name) return host.parameter(name) end,
  }),
  proximity = singleton("proximity", {
    num_sensors = function() return host.proximity_sensors() end,
    get_status = function() return host.proximity_status() end,
  }),
  rc = singleton("rc", {
    get_aux_cached = function(number) return host.switch(whole(number, 0, 65535)) end,
  }),
}
