#include "firmware/modbus/server.h"

#include <doctest/doctest.h>
#include <modbus.h>
#include <sys/resource.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <ctime>
#include <memory>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "tests/modbus/served.h"

using namespace finsight;
using namespace std::chrono_literals;
using namespace finsight::tests;

namespace {

ModbusSettings with_clients(int max_clients) {
  ModbusSettings settings;
  settings.max_clients = settings.max_per_address = max_clients;
  return settings;
}

}  // namespace

TEST_CASE("server: before the first result it serves a block that is not ready and has no valid values") {
  ModbusSettings settings;
  settings.port = 0;
  Control control;
  ModbusServer server(settings, control);
  Connection client(server.port());
  const Bytes reply = client.ask(hex("0001 0000 0006 01 03 0000 0030"), 9 + 96);
  REQUIRE(reply.size() == 9 + 96);
  CHECK(word_at(reply, 0) == 0);
  CHECK(word_at(reply, 3) == 65535);
  CHECK(word_at(reply, 5) == 0x8000);
  CHECK(word_at(reply, 39) == 0x1234);
}

TEST_CASE("server: the age is that at the time of the read") {
  Served served;
  Connection client(served.port());
  RegisterImage image;
  image.words[3] = 7;
  image.words[4] = 0x4444;
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  image.exposure_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(now - 1s).count();
  (*served).publish(image);
  const Bytes request = hex("0001 0000 0006 01 03 0003 0002");
  const Bytes first = client.ask(request, 13);
  std::this_thread::sleep_for(10ms);
  const Bytes second = client.ask(request, 13);
  REQUIRE(first.size() == 13);
  REQUIRE(second.size() == 13);
  CHECK(word_at(first, 0) >= 10000);
  CHECK(word_at(second, 0) >= word_at(first, 0) + 99);
  CHECK(word_at(second, 1) == 0x4444);
  image.exposure_ns += 3600 * 1'000'000'000LL;
  (*served).publish(image);
  CHECK(client.ask(request, 13) == hex("0001 0000 0007 01 03 04 0000 4444"));
}

TEST_CASE("server: in one answer a stalled block has fault 8 and neither a bit nor a value of its old frame") {
  Served served;
  Connection client(served.port());
  served.control().set_stale_after(300'000'000);
  PlatePoses poses;
  poses.seen = {true, true, true};
  poses.quality = Quality::kFresh;
  FingerShape shape;
  shape.front_rms_mm = shape.largest_mm = shape.rms_mm = 3;
  shape.quality = Quality::kFresh;
  Touch touch;
  touch.force_n = 3;
  touch.quality = Quality::kFresh;
  LoopState state;
  state.limits = {true, true, true};
  const auto block = [&](std::chrono::milliseconds age) {
    const auto exposure = std::chrono::steady_clock::now().time_since_epoch() - age;
    state.exposure_ns = state.published_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(exposure).count();
    RegisterImage image;
    encode_registers(poses, shape, touch, state, image);
    (*served).publish(image);
    const Bytes reply = client.ask(hex("0001 0000 0006 01 03 0000 0055"), 179);
    REQUIRE(reply.size() == 179);
    std::vector<std::uint16_t> words;
    for (std::size_t i = 0; i < std::size_t{kMeasurementRegisters}; ++i) words.push_back(word_at(reply, i));
    return words;
  };
  const std::uint16_t seen = kTopSeen | kMiddleSeen | kLowSeen;
  const std::uint16_t well = kReady | kTouchValid | kContact | kShapeValid | kOverload | seen;
  CHECK(block(0ms)[0] == well);
  CHECK(block(0ms)[44] == 7);
  for (const bool keeps : {false, true}) {
    CAPTURE(keeps);
    const ClientAccess access{.may_write = true, .address = 1};
    served.control().write(1004, std::array{kDefaultWriteKey}, access, 0);
    REQUIRE(served.control().write(1017, std::array{static_cast<std::uint16_t>(keeps)}, access, 0) == Exception::kNone);
    const std::vector<std::uint16_t> words = block(301ms);
    CHECK(words[1] == 8);
    CHECK(words[0] == (keeps ? (well & ~kReady) | kHeld | kAnyFault : +kAnyFault));
    CHECK(words[44] == (keeps ? 7 : 0));
    for (const RegisterRow& row : kRegisterTable.measurements) {
      const bool is_of_frame = row.may_be_invalid() && row.address < address_of("force_scale");
      if (!is_of_frame || row.address == address_of("age") || row.address == 30) continue;
      CAPTURE(row.name);
      const std::uint16_t word = words[static_cast<std::size_t>(row.address)];
      const std::uint16_t invalid = row.type == RegisterType::kInt16    ? 0x8000
                                    : row.type == RegisterType::kUint16 ? 0xFFFF
                                                                        : 0x7FC0;
      CHECK((word == invalid) == !keeps);
    }
    CHECK(words[3] >= 3010);
  }
}

TEST_CASE("server: serves 32 clients, closes one more, and uses a place again that becomes free") {
  Served served(with_clients(32));
  std::vector<Connection> clients;
  for (int i = 0; i < 32; ++i) {
    clients.emplace_back(served.port());
    REQUIRE(is_answered(clients.back()));
  }
  Connection refused(served.port());
  CHECK(refused.is_closed_by_server());
  for (Connection& client : clients) CHECK(is_answered(client));
  clients[17].close();
  bool served_again = false;
  for (int attempt = 0; attempt < 200 && !served_again; ++attempt) {  // the server may notice the close a little later
    Connection next(served.port());
    served_again = is_answered(next);
  }
  CHECK(served_again);
}

TEST_CASE("server: quiet clients lose their places to newcomers, busy ones do not") {
  Served served(with_clients(4));
  Connection busy(served.port()), quiet(served.port()), mute(served.port()), half(served.port());
  CHECK(is_answered(quiet));
  REQUIRE(half.send(hex("0001")));
  const auto keep_busy = [&](int times) {
    for (int i = 0; i < times; ++i) {
      std::this_thread::sleep_for(200ms);
      CHECK(is_answered(busy));
    }
  };
  keep_busy(11);  // 2.2 s
  Connection first(served.port()), second(served.port());
  CHECK(is_answered(first));
  CHECK(is_answered(second));
  CHECK(mute.is_closed_by_server());
  CHECK(half.is_closed_by_server());
  Connection third(served.port());
  CHECK(third.is_closed_by_server());  // `quiet` has sent a request not long ago

  keep_busy(51);  // 10.2 s: all but `busy` are quiet, and each newcomer replaces one of them
  std::vector<Connection> burst;
  for (int i = 0; i < 3; ++i) burst.emplace_back(served.port());
  for (Connection& newcomer : burst) CHECK(is_answered(newcomer));
  CHECK(is_answered(busy));
}

TEST_CASE("server: partial frames, floods and unread answers do not keep another client from being served") {
  Served served(with_clients(32));
  std::vector<Connection> stalled;
  for (const std::size_t length : {1U, 6U, 7U, 8U, 11U}) {
    stalled.emplace_back(served.port());
    REQUIRE(stalled.back().send(Bytes(kReadOne.begin(), kReadOne.begin() + static_cast<std::ptrdiff_t>(length))));
  }
  std::atomic<bool> stop{false};
  std::atomic<int> floods{0};
  const auto flood = [&](const Bytes& unit, bool reads_answers) {
    Bytes bytes;
    for (int i = 0; i < 200; ++i) bytes = bytes + unit;
    while (!stop) {
      Connection hostile(served.port());
      while (!stop && hostile.send(bytes)) {
        ++floods;
        std::array<std::uint8_t, 65536> unread;
        if (reads_answers) ::recv(hostile.fd(), unread.data(), unread.size(), MSG_DONTWAIT);
      }
    }
  };
  std::thread reader([&] { flood(kReadOne, true); });
  std::thread deaf([&] { flood(hex("0001 0000 0005 01 2B 0E 02 00"), false); });
  std::thread rude(
      [&] { flood(hex("0001 0000 0006 01 08 0000 0000") + hex("0002 0000 0006 01 03 0000 007E"), false); });
  std::thread wrong([&] { flood(Bytes(64, 0xFF), false); });
  while (floods < 20) std::this_thread::yield();

  Connection good(served.port());
  int answers = 0;
  for (int i = 0; i < 500; ++i) answers += is_answered(good);
  stop = true;
  for (std::thread* thread : {&reader, &deaf, &rude, &wrong}) thread->join();
  CHECK(answers == 500);
  for (Connection& client : stalled) CHECK(client.is_closed_by_server());  // by the time limit of a frame
  CHECK(is_answered(good));
}

TEST_CASE("server: a client that never reads its answers is closed") {
  Served served;
  Connection deaf(served.port(), 4096);
  Bytes requests;
  for (int i = 0; i < 1000; ++i) requests = requests + hex("0001 0000 0006 01 03 0000 0030");
  int rounds = 0;
  while (rounds < 1000 && deaf.send(requests)) ++rounds;  // one million answers would be 105 MB
  CHECK(rounds < 1000);
  CHECK_FALSE(deaf.send(requests));
}

TEST_CASE("server: a client that reads slowly gets all the answers to what it pipelines") {
  Served served;
  Connection slow(served.port(), 4096);
  Bytes requests;
  constexpr std::size_t kRequests = 4000, kReply = 9 + 96;  // 420 kB: more than the kernel's buffers hold
  for (std::size_t i = 0; i < kRequests; ++i) requests = requests + hex("0001 0000 0006 01 03 0000 0030");
  REQUIRE(slow.send(requests));
  std::this_thread::sleep_for(1500ms);
  CHECK(slow.receive(kRequests * kReply).size() == kRequests * kReply);
}

TEST_CASE("server: one address that holds all it can get keeps no other out, and a reserved one always gets in") {
  ModbusSettings settings = with_clients(8);
  settings.address = "0.0.0.0";
  settings.reserve = {0x7F000009};
  Served served(settings);
  std::vector<Connection> greedy;
  const auto fill = [&] {
    for (int i = 0; i < 16; ++i) {
      greedy.emplace_back(served.port(), 0, "127.0.0.2");
      if (!is_answered(greedy.back())) greedy.pop_back();
    }
  };
  fill();
  CHECK(greedy.size() == 7);  // one of eight is kept
  Connection other(served.port(), 0, "127.0.0.3"), plc(served.port(), 0, "127.0.0.9");
  CHECK(is_answered(other));
  CHECK(is_answered(plc));
  fill();
  CHECK(is_answered(other));
  CHECK(is_answered(plc));
  // After a cable pull the old connections stay open on this side; the PLC comes back again and again.
  std::vector<Connection> reconnected;
  for (int i = 0; i < 20; ++i) {
    fill();
    reconnected.emplace_back(served.port(), 0, "127.0.0.9");
    CHECK(is_answered(reconnected.back()));
  }
  CHECK(is_answered(other));
}

TEST_CASE("server: an address gets no more places than it may have, although there are free ones") {
  ModbusSettings settings = with_clients(8);
  settings.max_per_address = 3;
  Served served(settings);
  std::vector<Connection> clients;
  for (int i = 0; i < 3; ++i) {
    clients.emplace_back(served.port());
    CHECK(is_answered(clients.back()));
  }
  Connection refused(served.port());
  CHECK(refused.is_closed_by_server());
}

TEST_CASE("server: a silent client is closed after the idle limit, a busy one is not") {
  ModbusSettings settings;
  settings.idle_limit_s = 1;
  Served served(settings);
  Connection silent(served.port()), busy(served.port());
  int answers = 0;
  for (int i = 0; i < 8; ++i) {
    std::this_thread::sleep_for(200ms);
    answers += is_answered(busy);
  }
  CHECK(answers == 8);
  CHECK(silent.is_closed_by_server());
}

TEST_CASE("server: clients that reset their connections before their answers do not kill the process") {
  Served served;
  const Bytes illegal = hex("0001 0000 0002 01 07");
  for (int i = 0; i < 200; ++i) {
    Connection client(served.port());
    client.send(i % 2 ? kReadOne + illegal : illegal + kReadOne);
    ::shutdown(client.fd(), SHUT_WR);  // a reset after this raises SIGPIPE
    client.reset();
  }
  bool answered = false;
  for (int attempt = 0; attempt < 200 && !answered; ++attempt) {
    Connection good(served.port());
    answered = is_answered(good);
  }
  CHECK(answered);
}

TEST_CASE("server: when descriptors run out, new clients wait and are served once there are some again") {
  Served served;
  Connection other(served.port());
  REQUIRE(is_answered(other));
  rlimit before{};
  ::getrlimit(RLIMIT_NOFILE, &before);
  const rlimit few{128, before.rlim_max};
  REQUIRE(::setrlimit(RLIMIT_NOFILE, &few) == 0);
  std::vector<int> fillers;
  for (int fd = ::dup(0); fd >= 0; fd = ::dup(0)) fillers.push_back(fd);
  ::close(fillers.back());
  Connection waiting(served.port());  // takes the last descriptor; the kernel connects it before the server accepts
  const bool other_answered = is_answered(other);
  const bool sent = waiting.send(kReadOne);
  const std::clock_t cpu_before = std::clock();
  std::this_thread::sleep_for(200ms);
  const std::clock_t cpu_used = std::clock() - cpu_before;
  const bool still_answered = is_answered(other);
  for (std::size_t i = 0; i + 1 < fillers.size(); ++i) ::close(fillers[i]);
  ::setrlimit(RLIMIT_NOFILE, &before);
  CHECK(other_answered);
  CHECK(still_answered);
  CHECK(cpu_used < CLOCKS_PER_SEC / 100);  // the server waits and does not spin
  CHECK(sent);
  CHECK(waiting.receive(kReadOneReply.size()) == kReadOneReply);
}

TEST_CASE("server: a read is one snapshot even while results are published without pause") {
  Served served;
  RegisterImage image;
  (*served).publish(image);
  std::atomic<bool> stop{false};
  std::thread publisher([&] {
    for (std::uint16_t n = 0; !stop; ++n) {
      image.words.fill(n);
      (*served).publish(image);
    }
    image.words.fill(0xABCD);
    (*served).publish(image);
  });
  int torn = 0, changes = 0;
  std::uint16_t last = 0;
  Connection client(served.port());
  const Bytes request = hex("0001 0000 0006 01 04 0004 002C");
  for (int i = 0; i < 3000 || (changes < 20 && i < 300'000); ++i) {
    const Bytes reply = client.ask(request, 9 + 88);
    REQUIRE(reply.size() == 9 + 88);
    for (std::size_t w = 1; w < 44; ++w) torn += word_at(reply, w) != word_at(reply, 0);
    changes += word_at(reply, 0) != std::exchange(last, word_at(reply, 0));
  }
  stop = true;
  publisher.join();
  CHECK(torn == 0);
  CHECK(changes >= 20);
  CHECK(word_at(client.ask(request, 9 + 88), 0) == 0xABCD);  // the last block published is the one served
}

TEST_CASE("server: a port in use is refused, naming address and port") {
  Served first;
  ModbusSettings settings;
  settings.port = first.port();
  for (const char* address : {"127.0.0.1", "0.0.0.0"}) {
    settings.address = address;
    try {
      Control control;
      ModbusServer second(settings, control);
      FAIL("two servers on one port");
    } catch (const std::system_error& error) {
      CHECK(error.code() == std::errc::address_in_use);
      CHECK(std::string(error.what()).find(address + (":" + std::to_string(first.port()))) != std::string::npos);
    }
  }
}

TEST_CASE("server: an address that is not IPv4 or not of this machine is refused, naming it") {
  ModbusSettings settings;
  settings.port = 0;
  Control control;
  for (const char* address : {"", "plc.local", "::1", "1.2.3", "203.0.113.7"}) {
    settings.address = address;
    CHECK_THROWS_WITH_AS(ModbusServer(settings, control), doctest::Contains("Modbus cannot listen on"),
                         std::system_error);
  }
}

TEST_CASE("server: a restarted server gets its port at once although old connections linger") {
  ModbusSettings settings;
  settings.port = 0;
  Control control;
  auto server = std::make_unique<ModbusServer>(settings, control);
  settings.port = server->port();
  Connection client(settings.port);
  REQUIRE(client.ask(kReadOne, kReadOneReply.size()).size() == kReadOneReply.size());
  server.reset();
  CHECK(client.is_closed_by_server());
  server = std::make_unique<ModbusServer>(settings, control);
  Connection next(settings.port);
  CHECK(next.ask(kReadOne, kReadOneReply.size()).size() == kReadOneReply.size());
}

TEST_CASE("server: while a command runs, other writes are busy") {
  Served served;
  Connection client(served.port());
  const auto ask = [&](const std::string& request, const std::string& reply) {
    CHECK(client.ask(hex(request), hex(reply).size()) == hex(reply));
  };
  ask("0001 0000 0006 01 06 03EC 4653", "0001 0000 0006 01 06 03EC 4653");
  ask("0002 0000 000B 01 10 03E8 0002 04 0001 0007", "0002 0000 0006 01 10 03E8 0002");
  ask("0003 0000 0006 01 06 03F8 0064", "0003 0000 0003 01 86 06");
  ask("0004 0000 000B 01 10 03E8 0002 04 0002 0008", "0004 0000 0003 01 90 06");
  ask("0005 0000 000B 01 10 03E8 0002 04 0001 0007", "0005 0000 0006 01 10 03E8 0002");  // the same again
  ask("0006 0000 0006 01 03 03E8 0004", "0006 0000 000B 01 03 08 0001 0007 0000 0000");
  CHECK(served.control().take_command() == Command::kZero);
  served.control().finish(CommandResult::kNotPossible);
  ask("0007 0000 0006 01 03 03E8 0004", "0007 0000 000B 01 03 08 0001 0007 0007 0001");
  ask("0008 0000 0006 01 06 03F8 0064", "0008 0000 0006 01 06 03F8 0064");
}

TEST_CASE("server: with a unit id of its own, it answers that one, 0 and 255 only") {
  ModbusSettings settings;
  settings.unit = 17;
  Served served(settings);
  Connection client(served.port());
  for (int unit = 0; unit < 256; ++unit) {
    Bytes request = kReadOne, reply = kReadOneReply;
    request[6] = reply[6] = static_cast<std::uint8_t>(unit);
    if (unit == 0 || unit == 17 || unit == 255) {
      CHECK(client.ask(request, reply.size()) == reply);
    } else {
      REQUIRE(client.send(request));
    }
  }
  CHECK(client.ask(kReadOne, 0).empty());
}

TEST_CASE("server: closes clients that are not on the list, and does not unlock those that may only read") {
  ModbusSettings settings;
  settings.allow = {*Network::parse("10.0.0.0/8"), *Network::parse("127.0.0.2")};
  Served closed(settings);
  Connection stranger(closed.port());
  CHECK_FALSE(is_answered(stranger));
  settings.allow = {*Network::parse("127.0.0.0/8")};
  settings.allow_writes = {*Network::parse("127.0.0.2")};
  Served readable(settings);
  Connection reader(readable.port());
  CHECK(is_answered(reader));
  CHECK(reader.ask(hex("0001 0000 0006 01 06 03EC 4653"), 9) == hex("0001 0000 0003 01 86 04"));
}

TEST_CASE("server: the key unlocks all connections of its client, and no other client") {
  ModbusSettings settings;
  settings.address = "0.0.0.0";
  Served served(settings);
  Connection first(served.port()), second(served.port()), stranger(served.port(), 0, "127.0.0.2");
  const Bytes key = hex("0001 0000 0006 01 06 03EC 4653"), write = hex("0001 0000 0006 01 06 03F8 0064");
  CHECK(first.ask(key, key.size()) == key);
  CHECK(second.ask(write, write.size()) == write);
  CHECK(stranger.ask(write, 9) == hex("0001 0000 0003 01 86 04"));
  CHECK(first.ask(hex("0001 0000 0006 01 03 03EC 0001"), 11) == hex("0001 0000 0005 01 03 02 001E"));
  CHECK(stranger.ask(hex("0001 0000 0006 01 03 03EC 0001"), 11) == hex("0001 0000 0005 01 03 02 0000"));
}

TEST_CASE("server: libmodbus as a client reads the block and understands the exceptions") {
  Served served;
  const std::unique_ptr<modbus_t, decltype(&modbus_free)> client(modbus_new_tcp("127.0.0.1", served.port()),
                                                                 &modbus_free);
  REQUIRE(modbus_connect(client.get()) == 0);
  std::array<std::uint16_t, 125> words{};
  CHECK(modbus_read_registers(client.get(), 4, 44, words.data()) == 44);
  CHECK(words[0] == 0x1004);
  CHECK(words[43] == 0x102F);
  CHECK(modbus_read_input_registers(client.get(), 40, 8, words.data()) == 8);
  CHECK(words[7] == 0x102F);
  CHECK(modbus_read_registers(client.get(), 77, 9, words.data()) == -1);
  CHECK(errno == EMBXILADD);
  CHECK(modbus_write_register(client.get(), 0, 1) == -1);
  CHECK(errno == EMBXILADD);
  CHECK(modbus_write_register(client.get(), 1016, 100) == -1);
  CHECK(errno == EMBXSFAIL);  // locked
  CHECK(modbus_write_register(client.get(), 1004, kDefaultWriteKey) == 1);
  CHECK(modbus_write_register(client.get(), 1016, 100) == 1);
  const std::array<std::uint16_t, 2> pair = {300, 250};
  CHECK(modbus_write_registers(client.get(), 1012, 2, pair.data()) == 2);
  CHECK(modbus_write_and_read_registers(client.get(), 1018, 1, pair.data(), 1012, 7, words.data()) == 7);
  CHECK(std::vector<int>(words.begin(), words.begin() + 7) == std::vector<int>{300, 250, 1000, 900, 100, 0, 300});
  CHECK(modbus_write_register(client.get(), 1016, 10001) == -1);
  CHECK(errno == EMBXILVAL);
  std::array<std::uint8_t, 125> bytes{};
  CHECK(modbus_report_slave_id(client.get(), 125, bytes.data()) == -1);
  CHECK(errno == EMBXILFUN);
  CHECK(modbus_read_bits(client.get(), 0, 1, bytes.data()) == -1);
  CHECK(errno == EMBXILFUN);
  CHECK(modbus_read_registers(client.get(), 0, 1, words.data()) == 1);
  modbus_close(client.get());
}
