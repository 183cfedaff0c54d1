#include "firmware/page/api.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <thread>

#include "firmware/page/import.h"
#include "firmware/page/json_body.h"
#include "firmware/page/picture.h"
#include "firmware/page/register_text.h"
#include "firmware/page/tar.h"

namespace finsight::page {

namespace {

using nlohmann::json;

constexpr std::int64_t kStart_ns = 3 * kNsPerS;  // of finsightd, which may just be starting with what was before
constexpr std::chrono::milliseconds kBetweenOrders(200);
constexpr double kBoardSquare_mm = 18;  // ten of them fit on a sheet of A4
// Of the image's system: which version runs, and whether another one has been installed and starts next.
constexpr const char *kRelease = "/usr/lib/finsight/release", *kRestarts = "/run/finsight/updated";
constexpr std::string_view kPicturePath = "/api/pictures/";
constexpr std::string_view kRecordingPath = "/api/recordings/";

Answer json_answer(const json& value) { return {.body = value.dump(-1, ' ', false, json::error_handler_t::replace)}; }
Answer done_or(const std::optional<Refusal>& refusal) {
  return refusal ? refused(*refusal) : json_answer({{"done", true}});
}

/// {"own": name, "fingers": [{"name", "port"}]} for the chooser.
std::string fingers_json(const Settings& own, std::span<const Settings> all) {
  json fingers = json::array();
  for (const Settings& finger : all) fingers.push_back({{"name", finger.name}, {"port", finger.page->port}});
  return json{{"own", own.name}, {"fingers", fingers}}.dump();
}

Answer not_found() { return refused({404, "There is nothing under this address."}); }

/// A member that must be a text; empty if it is not.
std::string text_of(const json& body, const char* name) {
  const auto found = body.find(name);
  return found != body.end() && found->is_string() ? found->get<std::string>() : "";
}

}  // namespace

Api::Api(const Settings& settings, Device& device, Setup& setup, BadPictures& bad_pictures,
         std::span<const Asset> assets, std::span<const Settings> fingers)
    : settings_(settings),
      device_(device),
      setup_(setup),
      bad_pictures_(bad_pictures),
      sessions_(settings.write_key, *settings.page),
      updates_(settings.page->updates, kRelease, kRestarts),
      assets_(assets),
      recordings_(settings.recordings),
      fingers_(fingers_json(settings, fingers)),
      table_(register_table_json().dump()) {}

Answer Api::handle(const Request& request) {
  try {
    return request.method == "POST" ? post(request) : get(request);
  } catch (const std::exception& error) {
    return refused({500, std::string("Something went wrong: ") + error.what() + "."});
  }
}

Answer Api::get(const Request& request) {
  const std::string& path = request.path;
  for (const Asset& asset : assets_) {
    if (path != asset.path && !(path == "/" && std::strcmp(asset.path, "/index.html") == 0)) continue;
    return {.type = asset.type,
            .body = std::string(asset.gzip.begin(), asset.gzip.end()),
            .is_gzip = true,
            .may_be_kept = true};
  }
  if (path == "/frame.jpg") return picture();
  if (path == "/shape.bin") return shape();
  if (path == "/metrics") {
    return of_values(
        [](const json& values) { return Answer{.type = "text/plain; version=0.0.4", .body = metrics_text(values)}; });
  }
  if (path == "/api/events") return {.is_event_stream = true};
  if (path == "/api/state") return of_values(json_answer);
  if (path == "/api/registers") return {.body = table_};
  if (path == "/api/fingers") return {.body = fingers_};
  if (path == "/api/about") {
    std::string about = device_.about();
    if (about.empty()) return refused({503, "finsightd publishes nothing: it is not running, or is in safe mode."});
    return {.body = std::move(about)};
  }
  if (path == "/api/lens") return json_answer(setup_.lens());
  if (path == "/api/mount") return json_answer(setup_.mount());
  if (path == "/api/lens/board.svg") {
    return {.type = "image/svg+xml", .body = board_svg(CharucoBoard{}, kBoardSquare_mm), .file_name = "board.svg"};
  }
  if (path == "/api/lens/file" || path == "/api/mount/file") {
    const bool is_lens = path == "/api/lens/file";
    std::string file = is_lens ? setup_.lens_toml() : setup_.mount_toml();
    if (file.empty()) return refused({404, "There is no result yet."});
    return {.type = "application/toml", .body = std::move(file), .file_name = is_lens ? "lens.toml" : "mount.toml"};
  }
  if (path == "/api/export") return export_all();
  if (path == "/api/diagnostics") return {.body = diagnostics().dump(2), .file_name = "finsight-diagnostics.json"};
  if (path == "/api/diagnostics.tar") return everything();
  if (path == "/api/log") return {.type = "text/plain; charset=utf-8", .body = log()};
  if (path == "/api/update") return json_answer(updates_.state());
  if (path == "/api/pictures") return json_answer(bad_pictures_.list(steady_now_ns()));
  if (path.starts_with(kPicturePath) && path.ends_with(".jpg")) {
    std::string jpeg = bad_pictures_.jpeg(std::atoi(path.c_str() + kPicturePath.size()));
    if (!jpeg.empty()) return {.type = "image/jpeg", .body = std::move(jpeg)};
  }
  if (path == "/api/recordings")
    return json_answer({{"configured", !settings_.recordings.empty()}, {"sessions", recordings_.list()}});
  if (path.starts_with(kRecordingPath) && path.ends_with(".tar")) {
    const std::string name = path.substr(kRecordingPath.size(), path.size() - kRecordingPath.size() - 4);
    if (auto tar = recordings_.tar(name)) {
      return {.type = "application/x-tar", .file_name = name + ".tar", .more = std::move(tar)};
    }
  }
  return not_found();
}

/// Made of the registers' values, or why there are none.
Answer Api::of_values(Answer (*answer)(const json& values)) {
  const json values = device_.values();
  return values.contains("error") ? refused({503, text_of(values, "error")}) : answer(values);
}

Answer Api::picture() {
  device_.watch();
  const auto picture = device_.picture();
  if (!picture || picture->grey.empty()) return refused({503, "There is no picture yet."});
  if (picture->number == jpeg_number_) return jpeg_;
  const PictureQuality quality = quality_of(*picture);
  const auto number = [](double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.3f", value);
    return std::string(text);
  };
  jpeg_ = {.type = "image/jpeg",
           .body = jpeg_of(*picture),
           .fields = {{"X-Finsight-Frame", std::to_string(picture->number)},
                      {"X-Finsight-Edge-Px", number(quality.edge_px)},
                      {"X-Finsight-Mean", number(quality.mean)},
                      {"X-Finsight-White", number(quality.white_share)}}};
  jpeg_number_ = picture->number;
  return jpeg_;
}

Answer Api::shape() {
  device_.watch();
  const auto shape = device_.shape();
  if (!shape) return refused({503, "There is no shape now."});
  Answer answer{.type = "application/octet-stream", .fields = {{"X-Finsight-Frame", std::to_string(shape->first)}}};
  answer.body.resize(2 * shape->second.size());
  for (std::size_t i = 0; i < shape->second.size(); ++i) {  // little-endian, whatever the processor
    const auto word = static_cast<std::uint16_t>(shape->second[i]);
    answer.body[2 * i] = static_cast<char>(word & 0xFF);
    answer.body[2 * i + 1] = static_cast<char>(word >> 8);
  }
  return answer;
}

Answer Api::export_all() {
  const json values = device_.values();
  if (values.contains("error")) return refused({503, values["error"].get<std::string>()});
  const json about = json_body(device_.about());
  if (!about.is_object()) return refused({503, "finsightd publishes nothing, so lens, mount and zero are not known."});
  json file = export_file(device_.settings_json(), about, device_.frame());
  file["serial_number"] = values["serial_number"];
  file["firmware_version"] = values["firmware_version"];
  Answer answer{.body = file.dump(2) + "\n", .file_name = "finsight-" + text_of(values, "serial_number") + ".json"};
  std::erase_if(answer.file_name,
                [](char c) { return !(std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '.'); });
  return answer;
}

Answer Api::import_all(const json& file) {
  const std::filesystem::path& folder = settings_.page->measured;
  if (folder.empty() || settings_.saved_state.empty()) {
    return refused({409, "Nothing can be imported here: the board file has no page.measured or no storage.settings."});
  }
  std::vector<PartText> import;
  if (const auto refusal = read_import(file, finger_at_start(settings_), import)) return refused(*refusal);
  return stored([&](const Restart& restart) { return store_parts(folder, import, restart); });
}

/// Where finsightd does not answer there is nothing to restart. That must not be in the way: what is stored may be what
/// makes it start again.
Answer Api::stored(const std::function<std::optional<Refusal>(const Restart&)>& store) {
  bool answers = true;
  const auto refusal = store([&] {
    std::uint16_t sequence = 0;
    const std::int64_t until_ns = steady_now_ns() + kStart_ns;
    auto problem = device_.order("reset", sequence);
    while (problem && problem->status == kDoesNotAnswer && steady_now_ns() < until_ns) {
      std::this_thread::sleep_for(kBetweenOrders);
      problem = device_.order("reset", sequence);
    }
    answers = !problem || problem->status != kDoesNotAnswer;
    return answers ? problem : std::nullopt;
  });
  if (refusal || answers) return done_or(refusal);
  return json_answer({{"done", true},
                      {"note",
                       "The measuring program does not answer, so it uses this from its next start on. A device starts "
                       "it by itself; on a workstation start finsightd."}});
}

json Api::diagnostics() {
  json about = json_body(device_.about());
  if (about.is_object()) {
    about.erase("surface");
  } else {
    about = nullptr;
  }
  json file = {{"finsight_diagnostics", 1},
               {"about", about},
               {"registers", device_.values()},
               {"pictures", bad_pictures_.list(steady_now_ns())},
               {"update", updates_.state()}};
  if (const auto frame = device_.frame()) {
    for (std::size_t s = 0; s < kPublishedStages.size(); ++s) {
      const PublishedTimes& times = frame->times[s];
      file["stage_times_us"][kPublishedStages[s]] = {
          {"p50", times.p50_us}, {"p99", times.p99_us}, {"worst", times.worst_us}};
    }
  }
  return file;
}

/// What finsightd has said, the end of it.
std::string Api::log() const {
  std::string text;
  const std::filesystem::path& own = settings_.page->folder;
  const std::filesystem::path folder = settings_.name.empty() ? own : own.parent_path();  // of the board
  for (const char* name : {kLogBefore, kLogName}) {
    std::ifstream in(folder / name);
    text.append(std::istreambuf_iterator<char>(in), {});
  }
  return text;
}

Answer Api::everything() {
  std::vector<TarPart> parts = {{.name = "diagnostics.json", .text = diagnostics().dump(2) + "\n"},
                                {.name = "log.txt", .text = log()}};
  if (const Answer exported = export_all(); exported.status == 200) {
    parts.push_back({.name = "export.json", .text = exported.body});
  }
  for (const json& picture : bad_pictures_.list(steady_now_ns())) {
    const int id = picture["id"].get<int>();
    parts.push_back({.name = "picture-" + std::to_string(id) + ".jpg", .text = bad_pictures_.jpeg(id)});
  }
  return {.type = "application/x-tar", .file_name = "finsight-diagnostics.tar", .more = tar_of(std::move(parts))};
}

Intake Api::begin_update(const Request& request, std::uint64_t bytes) {
  if (request.method != "POST") return {Refusal{405, "An update is sent with POST."}};
  if (request.content_type != "application/octet-stream") {
    return {Refusal{415, "Expected a body of type application/octet-stream."}};
  }
  if (auto refusal = sessions_.check_token(request, steady_now_ns())) return {std::move(refusal)};
  return updates_.begin(bytes);
}

Answer Api::post(const Request& request) {
  // Its body has been taken already, and its token was checked before: begin_update().
  if (request.path == HttpServer::kUploadPath) return json_answer({{"done", true}});
  if (!request.content_type.starts_with("application/json")) {
    return refused({415, "Expected a body of type application/json."});
  }
  const json body = json_body(request.body);
  if (!body.is_object()) return refused({400, "The body is not a JSON object."});
  if (request.path == "/api/unlock") return unlock(request, body);
  if (const auto refusal = sessions_.check_token(request, steady_now_ns())) return refused(*refusal);
  return change(request, body);
}

Answer Api::unlock(const Request& request, const json& body) {
  const auto key = body.find("key");
  if (key == body.end() || !key->is_number_unsigned() || key->get<std::uint64_t>() > 0xFFFF) {
    return refused({400, "The key is a number from 1 to 65535."});
  }
  const Sessions::Unlock unlock = sessions_.unlock(key->get<std::uint16_t>(), request.client, steady_now_ns());
  if (unlock.token.empty()) return refused(unlock.refusal);
  return json_answer({{"token", unlock.token}, {"seconds", kUnlocked_ns / kNsPerS}});
}

Answer Api::change(const Request& request, const json& body) {
  const std::string& path = request.path;
  if (path == "/api/lock") {
    sessions_.end(request.token);
    return json_answer({{"done", true}});
  }
  if (path == "/api/command") {
    std::uint16_t sequence = 0;
    if (const auto refusal = device_.order(text_of(body, "command"), sequence)) return refused(*refusal);
    return json_answer({{"sequence", sequence}});
  }
  if (path == "/api/settings") return done_or(device_.change_settings(body));
  if (path == "/api/exclusive") {
    const auto on = body.find("on");
    if (on == body.end() || !on->is_boolean()) return refused({400, "Expected {\"on\": true or false}."});
    return done_or(device_.write(kExclusiveRegister, std::array<std::uint16_t, 1>{on->get<bool>()}));
  }
  if (path == "/api/import") return import_all(body);
  if (path.starts_with("/api/lens/") || path.starts_with("/api/mount/") || path.starts_with("/api/fit/")) {
    return set_up(path, body);
  }
  if (path == "/api/recordings/delete")
    return done_or(recordings_.remove(text_of(body, "name"), device_.is_recording()));
  return not_found();
}

Answer Api::set_up(const std::string& path, const json& body) {
  const auto use = [&](Part part, const std::string& toml) {
    return stored([&](const Restart& restart) { return setup_.use(part, toml, restart); });
  };
  const auto restore = [&](Part part) {
    return stored([&](const Restart& restart) { return setup_.restore(part, restart); });
  };
  if (path == "/api/lens/capture") return done_or(setup_.capture(body.value("only_still", json()) == true));
  if (path == "/api/lens/remove") {
    const auto id = body.find("id");
    if (id == body.end() || !id->is_number_integer()) return refused({400, "Expected {\"id\": a picture's number}."});
    return done_or(setup_.remove(id->get<std::int64_t>()));
  }
  if (path == "/api/lens/clear") return done_or(setup_.clear());
  if (path == "/api/lens/use") return use(Part::kLens, setup_.lens_toml());
  if (path == "/api/lens/restore") return restore(Part::kLens);
  if (path == "/api/mount/measure") return done_or(setup_.measure_mount());
  if (path == "/api/mount/use") return use(Part::kMount, setup_.mount_toml());
  if (path == "/api/mount/restore") return restore(Part::kMount);
  if (path == "/api/fit/use") return use(Part::kFit, text_of(body, "toml"));
  if (path == "/api/fit/restore") return restore(Part::kFit);
  return not_found();
}

}  // namespace finsight::page
