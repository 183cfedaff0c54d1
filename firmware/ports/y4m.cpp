// YUV4MPEG2: one text line for the stream, then per frame one text line and the raw pixels.
#include <sys/stat.h>

#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>

#include "firmware/input_error.h"
#include "firmware/ports/session.h"

namespace finsight {

namespace {

constexpr std::string_view kSignature = "YUV4MPEG2";
constexpr std::size_t kLongestStreamHeader = 1024;
constexpr std::size_t kLongestFrameHeader = 256;

/// What was found, shortened and made printable for an error message.
std::string shown(std::string_view text) {
  constexpr std::size_t kLongest = 40;
  std::string result = "'";
  for (const char c : text.substr(0, kLongest)) result += c >= ' ' && c <= '~' ? c : '?';
  return result + (text.size() > kLongest ? "...'" : "'");
}

/// All of `text` as a whole number; -1 if it is not one.
int whole_number(std::string_view text) {
  int value = -1;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() ? value : -1;
}

/// "60:1" -> 60; 0 for anything that is not a ratio of two positive whole numbers.
double ratio(std::string_view text) {
  const std::size_t colon = text.find(':');
  if (colon == std::string_view::npos) return 0;
  const int over = whole_number(text.substr(0, colon)), under = whole_number(text.substr(colon + 1));
  return over > 0 && under > 0 ? static_cast<double>(over) / under : 0;
}

}  // namespace

Y4mReader::Y4mReader(const std::filesystem::path& file, bool may_be_cut)
    : name_(file.string()), may_be_cut_(may_be_cut) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(file, ignored)) throw InputError(name_, "no such file");
  file_ = std::fopen(name_.c_str(), "rbe");
  if (!file_) throw InputError(name_, std::string("cannot be opened: ") + std::strerror(errno));
  try {
    read_stream_header();
  } catch (...) {
    std::fclose(file_);
    throw;
  }
}

Y4mReader::~Y4mReader() { std::fclose(file_); }

void Y4mReader::refuse(std::int64_t at, std::string_view found, const std::string& expected) const {
  throw InputError(name_, "byte " + std::to_string(at), shown(found), expected);
}

void Y4mReader::refuse_cut_frame(std::int64_t bytes_found) const {
  throw InputError(name_, "frame " + std::to_string(frame_) + " at byte " + std::to_string(position_),
                   "the end of the file after " + std::to_string(bytes_found) + " bytes",
                   std::to_string(frame_bytes_) + " bytes");
}

/// The line at position_ without its line feed; at the end of the file an empty one.
std::string Y4mReader::read_line(std::size_t longest) {
  const std::int64_t start = position_;
  std::string line;
  for (int c = std::getc(file_); c != EOF; c = std::getc(file_)) {
    ++position_;
    if (c == '\n') return line;
    line += static_cast<char>(c);
    if (line.size() > longest) refuse(start, line, "a line of at most " + std::to_string(longest) + " bytes");
  }
  if (std::ferror(file_)) throw InputError(name_, std::string("cannot be read: ") + std::strerror(errno));
  if (!line.empty()) refuse(start, line, "a line that is complete");
  return line;
}

void Y4mReader::read_stream_header() {
  const std::string line = read_line(kLongestStreamHeader);
  if (!line.starts_with(kSignature)) refuse(0, line, std::string(kSignature));
  std::size_t at = kSignature.size();
  bool grey = false;
  while (at < line.size()) {
    if (line[at] != ' ') refuse(static_cast<std::int64_t>(at), line.substr(at), "a space");
    const std::string_view parameter = std::string_view(line).substr(at + 1, line.find(' ', at + 1) - at - 1);
    read_parameter(parameter, static_cast<std::int64_t>(at + 1));
    grey = grey || parameter == "Cmono";
    at += 1 + parameter.size();
  }
  if (width_px_ == 0 || height_px_ == 0 || frames_per_second_ == 0 || !grey) {
    refuse(0, line, "width (W), height (H), frame rate (F) and Cmono");
  }
  frame_bytes_ = std::int64_t{width_px_} * height_px_;
  first_frame_ = position_;
}

void Y4mReader::read_parameter(std::string_view parameter, std::int64_t at) {
  const char tag = parameter.empty() ? ' ' : parameter.front();
  const std::string_view value = parameter.substr(parameter.empty() ? 0 : 1);
  switch (tag) {
    case 'W':
    case 'H': {
      int& side = tag == 'W' ? width_px_ : height_px_;
      const int number = whole_number(value);
      if (side != 0 || number < 1 || number > kMaxSide) {
        refuse(at, parameter, "one width and one height from 1 to " + std::to_string(kMaxSide) + " pixels");
      }
      side = number;
      return;
    }
    case 'F':
      if (frames_per_second_ != 0) refuse(at, parameter, "one frame rate");
      frames_per_second_ = ratio(value);
      if (!(frames_per_second_ >= 1 && frames_per_second_ <= 1000)) {
        refuse(at, parameter, "a frame rate from F1:1 to F1000:1");
      }
      return;
    case 'C':
      if (parameter != "Cmono") refuse(at, parameter, "Cmono (8-bit grey)");
      return;
    case 'I':
      if (parameter != "Ip" && parameter != "I?") refuse(at, parameter, "Ip (progressive)");
      return;
    case 'A':  // shape of the pixels: 0:0 means unknown; the calibration knows better
      if (parameter != "A0:0" && ratio(value) == 0) refuse(at, parameter, "a ratio like A1:1");
      return;
    case 'X':  // remarks of whatever wrote the file
      return;
    default:
      refuse(at, parameter, "one of the parameters W H F I A C X");
  }
}

bool Y4mReader::read_frame_header() {
  const std::int64_t start = position_;
  if (may_be_cut_ && frame_ >= whole_frames()) return false;
  const std::string line = read_line(kLongestFrameHeader);
  if (position_ == start) return false;  // the file ends where a frame could begin
  if (line != "FRAME" && !line.starts_with("FRAME ")) {
    refuse(start, line, "FRAME of frame " + std::to_string(frame_));
  }
  return true;
}

bool Y4mReader::next(std::vector<std::uint8_t>& grey) {
  if (!read_frame_header()) return false;
  grey.resize(static_cast<std::size_t>(frame_bytes_));
  const std::size_t found = std::fread(grey.data(), 1, grey.size(), file_);
  if (std::ferror(file_)) throw InputError(name_, std::string("cannot be read: ") + std::strerror(errno));
  if (found != grey.size()) refuse_cut_frame(static_cast<std::int64_t>(found));
  position_ += frame_bytes_;
  ++frame_;
  return true;
}

bool Y4mReader::skip() {
  if (!read_frame_header()) return false;
  // Seeking beyond the end succeeds, so a cut frame is only found by comparing with the file's size.
  struct stat status {};
  if (fstat(fileno(file_), &status) != 0 || fseeko(file_, frame_bytes_, SEEK_CUR) != 0) {
    throw InputError(name_, std::string("cannot be read: ") + std::strerror(errno));
  }
  if (status.st_size - position_ < frame_bytes_) refuse_cut_frame(status.st_size - position_);
  position_ += frame_bytes_;
  ++frame_;
  return true;
}

// A recording's frames have no parameters of their own, so all are of one size.
std::int64_t Y4mReader::whole_frames() const {
  struct stat status {};
  if (fstat(fileno(file_), &status) != 0) return 0;
  return (status.st_size - first_frame_) / (static_cast<std::int64_t>(kY4mFrame.size()) + frame_bytes_);
}

void Y4mReader::rewind() {
  if (fseeko(file_, first_frame_, SEEK_SET) != 0) {
    throw InputError(name_, std::string("cannot be read: ") + std::strerror(errno));
  }
  position_ = first_frame_;
  frame_ = 0;
}

std::string y4m_header(int width_px, int height_px, double frames_per_second) {
  // A ratio of whole numbers, to a millionth.
  const int under = frames_per_second == std::floor(frames_per_second) ? 1 : 1'000'000;
  char header[128];
  std::snprintf(header, sizeof header, "%s W%d H%d F%.0f:%d Ip A1:1 Cmono\n", kSignature.data(), width_px, height_px,
                frames_per_second * under, under);
  return header;
}

Y4mWriter::Y4mWriter(const std::filesystem::path& file, int width_px, int height_px, double frames_per_second)
    : file_(file), frame_bytes_(static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px)) {
  file_.write(y4m_header(width_px, height_px, frames_per_second));
}

void Y4mWriter::write(const std::uint8_t* grey) {
  file_.write(kY4mFrame);
  file_.write({reinterpret_cast<const char*>(grey), frame_bytes_});
}

void Y4mWriter::finish() { file_.commit(); }

}  // namespace finsight
