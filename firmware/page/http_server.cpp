#include "firmware/page/http_server.h"

#include <arpa/inet.h>
#include <microhttpd.h>
#include <sys/socket.h>

#include <algorithm>
#include <charconv>
#include <cstring>
#include <limits>
#include <list>
#include <mutex>
#include <nlohmann/json.hpp>
#include <system_error>
#include <vector>

namespace finsight::page {

namespace {

constexpr int kEventKinds = 2;

/// A connection, for as long as it is open.
struct Link {
  int descriptor = -1;
  std::int64_t since_ns = 0;
  bool is_awaited = true;  ///< a request, or the rest of one
};

/// A request that is coming in.
struct Incoming {
  Request request;
  bool is_too_long = false;
  std::function<bool(std::string_view)> take = nullptr;  ///< instead of the request's body
  std::uint64_t left = 0;                                ///< of what take() awaits
};

std::string field(MHD_Connection* connection, const char* name) {
  const char* value = MHD_lookup_connection_value(connection, MHD_HEADER_KIND, name);
  return value ? value : "";
}

std::uint32_t client_of(const sockaddr* address) {
  if (!address || address->sa_family != AF_INET) return 0;
  sockaddr_in ipv4{};
  std::memcpy(&ipv4, address, sizeof ipv4);
  return ntohl(ipv4.sin_addr.s_addr);
}

std::uint32_t client_of(MHD_Connection* connection) {
  const auto* info = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CLIENT_ADDRESS);
  return client_of(info ? info->client_addr : nullptr);
}

/// Of %-codes. A zero byte would end the text before its end, so that another path would be meant.
std::size_t unescape(void*, MHD_Connection*, char* text) {
  const std::size_t length = MHD_http_unescape(text);
  std::replace(text, text + length, '\0', '\1');
  return length;
}

void add_fields(MHD_Response* response, const Answer& answer) {
  const auto add = [&](const char* name, const std::string& value) {
    MHD_add_response_header(response, name, value.c_str());
  };
  add("Content-Type", answer.type);
  add("Cache-Control", answer.may_be_kept ? "no-cache" : "no-store");
  add("Content-Security-Policy",
      "default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'");
  add("X-Content-Type-Options", "nosniff");
  add("Referrer-Policy", "no-referrer");
  add("Cross-Origin-Resource-Policy", "same-origin");
  if (answer.is_gzip) add("Content-Encoding", "gzip");
  if (!answer.file_name.empty()) add("Content-Disposition", "attachment; filename=\"" + answer.file_name + "\"");
  for (const auto& [name, value] : answer.fields) add(name.c_str(), value);
}

}  // namespace

Answer refused(const Refusal& refusal) {
  return {
      .status = refusal.status,
      .body = nlohmann::json{{"error", refusal.reason}}.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)};
}

struct HttpServer::Impl {
  /// A browser that listens to events. What it has not taken is not queued: it gets the newest next.
  struct Stream {
    Impl& server;
    MHD_Connection* connection;
    std::uint32_t client;  ///< IPv4, host byte order
    std::array<std::uint64_t, kEventKinds> sent{};
    std::string pending = "retry: 1000\n\n";
    std::size_t taken = 0;
    bool is_waiting = false;
  };

  const PageSettings& settings;
  const std::function<Answer(const Request&)> handle;
  const std::function<Intake(const Request&, std::uint64_t)> begin_upload;
  MHD_Daemon* daemon = nullptr;
  std::mutex mutex;  ///< over what follows
  std::list<Link> links;
  std::list<Stream> streams;
  std::array<std::string, kEventKinds> newest;
  std::array<std::uint64_t, kEventKinds> numbers{};
  bool is_stopping = false;

  Impl(const PageSettings& page, std::function<Answer(const Request&)> handler,
       std::function<Intake(const Request&, std::uint64_t)> uploads)
      : settings(page), handle(std::move(handler)), begin_upload(std::move(uploads)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(settings.port));
    inet_pton(AF_INET, settings.address.c_str(), &address.sin_addr);
    daemon = MHD_start_daemon(
        MHD_USE_EPOLL_INTERNAL_THREAD | MHD_ALLOW_SUSPEND_RESUME, 0, &may_connect, this, &on_request, this,
        MHD_OPTION_SOCK_ADDR, reinterpret_cast<sockaddr*>(&address), MHD_OPTION_CONNECTION_LIMIT, kMostConnections,
        MHD_OPTION_PER_IP_CONNECTION_LIMIT, kMostPerAddress, MHD_OPTION_CONNECTION_TIMEOUT, kSilence_s,
        MHD_OPTION_CONNECTION_MEMORY_LIMIT, kConnectionMemory, MHD_OPTION_LISTENING_ADDRESS_REUSE, 1U,
        MHD_OPTION_STRICT_FOR_CLIENT, 1, MHD_OPTION_UNESCAPE_CALLBACK, &unescape, nullptr, MHD_OPTION_NOTIFY_COMPLETED,
        &on_completed, this, MHD_OPTION_NOTIFY_CONNECTION, &on_connection, this, MHD_OPTION_END);
    if (!daemon) {
      const int error = errno ? errno : EADDRINUSE;
      throw std::system_error(error, std::generic_category(),
                              "page: cannot listen on " + settings.address + ":" + std::to_string(settings.port));
    }
    if (settings.local_link_only) stay_on_the_link();
  }
  /// What leaves with this time to live goes as far as the first router.
  void stay_on_the_link() {
    const auto* info = MHD_get_daemon_info(daemon, MHD_DAEMON_INFO_LISTEN_FD);
    const int hops = 1;  // connections inherit it
    if (!info || setsockopt(info->listen_fd, IPPROTO_IP, IP_TTL, &hops, sizeof hops) != 0) {
      throw std::system_error(errno, std::generic_category(), "page.local_link_only");
    }
  }
  ~Impl() {
    {
      const std::lock_guard guard(mutex);
      is_stopping = true;
      wake_streams();
    }
    MHD_stop_daemon(daemon);
  }

  static MHD_Result may_connect(void* self, const sockaddr* address, socklen_t) {
    return is_listed(static_cast<Impl*>(self)->settings.allow, client_of(address)) ? MHD_YES : MHD_NO;
  }

  static void on_connection(void* self, MHD_Connection* connection, void** context,
                            MHD_ConnectionNotificationCode code) {
    Impl& server = *static_cast<Impl*>(self);
    const std::lock_guard guard(server.mutex);
    if (code == MHD_CONNECTION_NOTIFY_STARTED) {
      const auto* info = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD);
      server.links.push_back({info ? info->connect_fd : -1, steady_now_ns()});
      *context = &server.links.back();
    } else {
      server.links.remove_if([&](const Link& link) { return &link == *context; });
      *context = nullptr;
    }
  }

  void note_progress(MHD_Connection* connection, bool is_awaited) {
    const auto* info = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT);
    if (!info || !info->socket_context) return;
    const std::lock_guard guard(mutex);
    Link& link = *static_cast<Link*>(info->socket_context);
    link.is_awaited = is_awaited;
    link.since_ns = steady_now_ns();
  }

  static void on_completed(void* self, MHD_Connection* connection, void** incoming, MHD_RequestTerminationCode) {
    delete static_cast<Incoming*>(*incoming);
    *incoming = nullptr;
    static_cast<Impl*>(self)->note_progress(connection, true);
  }

  static MHD_Result on_request(void* self, MHD_Connection* connection, const char* url, const char* method, const char*,
                               const char* upload, std::size_t* upload_bytes, void** context) {
    Impl& server = *static_cast<Impl*>(self);
    auto* incoming = static_cast<Incoming*>(*context);
    if (!incoming) {
      *context = incoming = new Incoming{begin(connection, url, method)};
      if (const auto refusal = check_request(incoming->request, server.settings)) {
        return server.answer(connection, refused(*refusal));
      }
      const auto length = length_in(field(connection, MHD_HTTP_HEADER_CONTENT_LENGTH));
      if (incoming->request.path == kUploadPath) return server.begin_body(connection, *incoming, length);
      if (length.value_or(0) > kLongestBody) return server.answer(connection, refused({413, "The body is too long."}));
      return MHD_YES;
    }
    if (*upload_bytes > 0 && incoming->take) {
      const std::string_view piece(upload, *upload_bytes);
      *upload_bytes = 0;
      server.note_progress(connection, true);
      incoming->left -= std::min<std::uint64_t>(incoming->left, piece.size());
      return incoming->take(piece) ? MHD_YES : MHD_NO;
    }
    if (*upload_bytes > 0) {
      std::string& body = incoming->request.body;
      incoming->is_too_long = incoming->is_too_long || body.size() + *upload_bytes > kLongestBody;
      if (!incoming->is_too_long) body.append(upload, *upload_bytes);
      const bool give_up = incoming->is_too_long;
      *upload_bytes = 0;
      return give_up ? MHD_NO : MHD_YES;  // MHD_NO closes the connection
    }
    if (incoming->left > 0) return server.answer(connection, refused({400, "The file is not complete."}));
    return server.answer(connection, server.handle(incoming->request));
  }

  MHD_Result begin_body(MHD_Connection* connection, Incoming& incoming, std::optional<std::uint64_t> bytes) {
    if (!bytes) return answer(connection, refused({411, "The length of the file must be given."}));
    Intake intake = begin_upload(incoming.request, *bytes);
    if (intake.refusal) return answer(connection, refused(*intake.refusal));
    incoming.take = std::move(intake.take);
    incoming.left = *bytes;
    return MHD_YES;
  }

  static Request begin(MHD_Connection* connection, const char* url, const char* method) {
    return {.method = method,
            .path = url,
            .host = field(connection, MHD_HTTP_HEADER_HOST),
            .origin = field(connection, MHD_HTTP_HEADER_ORIGIN),
            .fetch_site = field(connection, "Sec-Fetch-Site"),
            .fetch_mode = field(connection, "Sec-Fetch-Mode"),
            .token = field(connection, "X-Finsight-Token"),
            .content_type = field(connection, MHD_HTTP_HEADER_CONTENT_TYPE),
            .body = {},
            .client = client_of(connection)};
  }

  /// Nothing: no length is given. What is no number counts as endless.
  static std::optional<std::uint64_t> length_in(const std::string& field) {
    if (field.empty()) return std::nullopt;
    std::uint64_t bytes = 0;
    const auto [end, error] = std::from_chars(field.data(), field.data() + field.size(), bytes);
    const bool is_number = error == std::errc() && end == field.data() + field.size();
    return is_number ? bytes : std::numeric_limits<std::uint64_t>::max();
  }

  MHD_Result answer(MHD_Connection* connection, Answer answer) {
    note_progress(connection, false);
    MHD_Response* response = nullptr;
    if (answer.is_event_stream) {
      if (const auto refusal = take_place(connection, response)) {
        answer = refused(*refusal);
      } else {
        answer.type = "text/event-stream";
      }
    }
    if (answer.more) {
      auto* more = new std::function<std::int64_t(char*, std::size_t)>(std::move(answer.more));
      response = MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, 64 * 1024, &next_bytes, more, &free_more);
    } else if (!response) {
      response = MHD_create_response_from_buffer(answer.body.size(), answer.body.data(), MHD_RESPMEM_MUST_COPY);
    }
    if (!response) return MHD_NO;
    add_fields(response, answer);
    const MHD_Result result = MHD_queue_response(connection, answer.status, response);
    MHD_destroy_response(response);
    return result;
  }

  static ssize_t next_bytes(void* more, std::uint64_t, char* bytes, std::size_t room) {
    const std::int64_t count = (*static_cast<std::function<std::int64_t(char*, std::size_t)>*>(more))(bytes, room);
    if (count == 0) return MHD_CONTENT_READER_END_OF_STREAM;
    return count < 0 ? MHD_CONTENT_READER_END_WITH_ERROR : static_cast<ssize_t>(count);
  }
  static void free_more(void* more) { delete static_cast<std::function<std::int64_t(char*, std::size_t)>*>(more); }

  /// One of the streams, if there is a place for it.
  std::optional<Refusal> take_place(MHD_Connection* connection, MHD_Response*& response) {
    const std::uint32_t client = client_of(connection);
    const std::lock_guard guard(mutex);
    if (std::ranges::count(streams, client, &Stream::client) >= kMostStreamsPerAddress) {
      return Refusal{503, "Too many pages of this device are open on your computer: close some of them."};
    }
    if (streams.size() >= kMostStreams) return Refusal{503, "Too many browsers are watching this device: close some."};
    streams.push_back({.server = *this, .connection = connection, .client = client});
    response =
        MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, 16 * 1024, &next_event, &streams.back(), &end_stream);
    return std::nullopt;
  }

  static ssize_t next_event(void* context, std::uint64_t, char* bytes, std::size_t room) {
    Stream& stream = *static_cast<Stream*>(context);
    Impl& server = stream.server;
    const std::lock_guard guard(server.mutex);
    if (server.is_stopping) return MHD_CONTENT_READER_END_OF_STREAM;
    if (stream.taken == stream.pending.size()) {
      stream.pending.clear();
      stream.taken = 0;
      for (std::size_t kind = 0; kind < kEventKinds; ++kind) {
        if (stream.sent[kind] == server.numbers[kind]) continue;
        stream.sent[kind] = server.numbers[kind];
        stream.pending += server.newest[kind];
      }
    }
    const std::size_t count = std::min(room, stream.pending.size() - stream.taken);
    if (count == 0) {
      stream.is_waiting = true;
      MHD_suspend_connection(stream.connection);
      return 0;
    }
    std::memcpy(bytes, stream.pending.data() + stream.taken, count);
    stream.taken += count;
    return static_cast<ssize_t>(count);
  }

  static void end_stream(void* context) {
    Impl& server = static_cast<Stream*>(context)->server;
    const std::lock_guard guard(server.mutex);
    server.streams.remove_if([&](const Stream& stream) { return &stream == context; });
  }

  void wake_streams() {
    for (Stream& stream : streams) {
      if (std::exchange(stream.is_waiting, false)) MHD_resume_connection(stream.connection);
    }
  }
};

HttpServer::HttpServer(const PageSettings& settings, std::function<Answer(const Request&)> handle,
                       std::function<Intake(const Request&, std::uint64_t)> begin_upload)
    : impl_(std::make_unique<Impl>(settings, std::move(handle), std::move(begin_upload))) {}
HttpServer::~HttpServer() = default;

void HttpServer::send_event(int kind, const std::string& name, const std::string& data) {
  const std::lock_guard guard(impl_->mutex);
  const auto at = static_cast<std::size_t>(kind);
  impl_->newest[at] = "event: " + name + "\ndata: " + data + "\n\n";
  ++impl_->numbers[at];
  impl_->wake_streams();
}

int HttpServer::streams() const {
  const std::lock_guard guard(impl_->mutex);
  return static_cast<int>(impl_->streams.size());
}

void HttpServer::close_slow(std::int64_t now_ns) {
  const std::lock_guard guard(impl_->mutex);
  for (const Link& link : impl_->links) {
    if (link.is_awaited && now_ns - link.since_ns > kRequestTime_ns) shutdown(link.descriptor, SHUT_RDWR);
  }
}

}  // namespace finsight::page
