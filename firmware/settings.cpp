#include "firmware/settings.h"

#include "firmware/input_error.h"
#include "firmware/toml_table.h"

namespace finsight {

namespace {

void read_source(TomlTable table, Settings& settings) {
  const bool session = table.choice("kind", {"session", "poses"}) == "session";
  settings.source = session ? Settings::Source::kSession : Settings::Source::kPoses;
  settings.replay.path = table.path("path");
  if (!session) settings.replay.recording = table.text("recording", "");
  settings.replay.recorded_speed = table.choice("speed", {"recorded", "full"}, "recorded") == "recorded";
  settings.replay.repeat = table.flag("repeat", false);
  table.finish();
}

void read_shape(TomlTable table, ShapeSettings& shape) {
  using Tier = ShapeSettings::Tier;
  const std::string tier = table.choice("tier", {"map", "map+newton", "newton"}, "newton");
  shape.tier = tier == "map" ? Tier::kMap : tier == "newton" ? Tier::kNewton : Tier::kMapAndNewton;
  shape.factorisations = static_cast<int>(table.integer("factorisations", 1, 10, 1));
  shape.chord_steps = static_cast<int>(table.integer("chord_steps", 0, 5, 1));
  table.finish();
}

void read_modbus(TomlTable table, Settings& settings) {
  settings.modbus.address = table.text("address", "127.0.0.1");
  settings.modbus.port = static_cast<int>(table.integer("port", 0, 65535, 502));
  settings.modbus.max_clients = static_cast<int>(table.integer("max_clients", 1, 64, 32));
  settings.modbus.idle_limit_s = static_cast<int>(table.integer("idle_limit_s", 1, 86400, 60));
  const std::string order = table.choice("word_order", {"ABCD", "CDAB"}, "ABCD");
  settings.loop.word_order = order == "ABCD" ? WordOrder::kABCD : WordOrder::kCDAB;
  table.finish();
}

void read_realtime(TomlTable table, RealtimeSettings& realtime) {
  realtime.priority = static_cast<int>(table.integer("priority", 0, 50, 0));
  realtime.cpu = static_cast<int>(table.integer("cpu", -1, 255, -1));
  realtime.lock_memory = table.flag("lock_memory", false);
  table.finish();
}

void read_network(TomlTable table, NetworkSettings& network) {
  if (table.choice("method", {"dhcp", "static"}) == "static") {
    network.address = table.text("address");
    network.gateway = table.text("gateway", "");
    if (!is_ipv4(network.address, true)) {
      throw InputError(table.where("address"), "network.address", "\"" + network.address + "\"",
                       "an address with its prefix length, such as \"192.168.0.40/24\"");
    }
    if (!network.gateway.empty() && !is_ipv4(network.gateway, false)) {
      throw InputError(table.where("gateway"), "network.gateway", "\"" + network.gateway + "\"",
                       "an address, such as \"192.168.0.1\"");
    }
  }
  table.finish();
}

}  // namespace

Settings read_settings(const std::filesystem::path& file, const std::filesystem::path& user) {
  TomlTable root = TomlTable::parse_file(file);
  if (!user.empty()) root.override_with(user);
  Settings settings;
  settings.pack = root.path("pack");
  read_source(root.table("source"), settings);
  if (root.has("shape")) read_shape(root.table("shape"), settings.loop.shape);
  read_modbus(root.table("modbus"), settings);
  settings.loop.hold_time_ns = root.integer("hold_time_ms", 0, 10000, 200) * 1'000'000;
  if (root.has("realtime")) read_realtime(root.table("realtime"), settings.realtime);
  if (root.has("network")) read_network(root.table("network"), settings.network);
  root.finish();
  return settings;
}

CameraModel camera_of(const SessionInfo& session) {
  const auto f = [](double value) { return static_cast<float>(value); };
  const auto& c = session.fx_fy_cx_cy;
  const auto& k = session.k1_k2_p1_p2_k3;
  return {session.width_px, session.height_px, f(c[0]), f(c[1]), f(c[2]), f(c[3]),
          f(k[0]),          f(k[1]),           f(k[2]), f(k[3]), f(k[4])};
}

}  // namespace finsight
