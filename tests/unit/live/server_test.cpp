// SPDX-License-Identifier: GPL-3.0-or-later
// The page's server over real connections: who gets in, what is handed out, and that the run never waits.
#include "servocal/live/server.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <httplib.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <thread>

#include "servocal/core/error.h"

namespace servocal::live {
namespace {

using Json = nlohmann::json;
using Steady = std::chrono::steady_clock;

procedure::Look lookAt(const std::string& camera, int shade, int width_px = 1920, int height_px = 1080) {
  procedure::Look look;
  look.camera = camera;
  look.frame.image = cv::Mat(height_px, width_px, CV_8UC1, cv::Scalar(shade));
  look.frame.stamp = Instant(std::chrono::milliseconds(935));
  look.arm.stamp = Instant(std::chrono::milliseconds(1000));
  look.arm.twist.linear_mps = {0.03, -0.04, 0.0};
  look.arm.max_frame_age = std::chrono::milliseconds(150);
  look.arm.guard.wanted = Twist<Base>{{0.06, -0.08, 0.0}, {0.0, 0.0, 0.1}};
  look.arm.guard.applied = Twist<Base>{{0.03, -0.04, 0.0}, {0.0, 0.0, 0.05}};
  look.arm.guard.rule = "speed";
  look.arm.guard.reason = "Slowed down to the speed limits.";
  look.arm.guard.interventions = {{"speed", 12}, {"workspace", 1}};
  look.arm.guard.refused_at = Instant(std::chrono::milliseconds(400));
  look.arm.guard.refused_reason = "The board would leave the workspace.";
  look.corners = {{100.0, 200.0}, {300.04, 400.0}};
  look.goal = {{1, 2}, {3, 4}, {5, 6}, {7, 8}};
  look.error_px = 12.345;
  return look;
}

procedure::Event eventWith(const std::string& message) {
  procedure::Event event;
  event.stamp = Instant(std::chrono::seconds(7));
  event.stage = "cover";
  event.camera = "cam1 color";
  event.done = 3;
  event.planned = 40;
  event.message = message;
  procedure::EyeProgress eye;
  eye.camera = "cam1";
  eye.sigma_m = 0.0021;
  eye.sigma_rad = 0.001;
  eye.coverage.cells_x = 2;
  eye.coverage.cells_y = 1;
  eye.coverage.corners_per_cell = {12, 3};
  eye.coverage.unreachable = {false, true};
  eye.coverage.corners_to_fill = 12;
  event.eyes = {eye};
  return event;
}

/// Status of a reply; the reason instead if there was none.
std::string statusOf(const httplib::Result& reply) {
  return reply ? std::to_string(reply->status) : httplib::to_string(reply.error());
}

class LiveServer : public ::testing::Test {
 protected:
  LiveServer() : server_(cell(), [this] { ++stops_; }) {
    const std::string& url = server_.url();
    const std::size_t at = url.find("/?token=");
    address_ = url.substr(0, at);
    port_ = std::stoi(url.substr(url.find(':', 7) + 1, at));
    token_ = url.substr(at + 8);
  }

  static CellConfig cell() {
    CellConfig cell;
    cell.name = "test cell";
    return cell;
  }

  httplib::Client client() const {
    httplib::Client client(address_);
    client.set_default_headers({{"X-Servocal-Token", token_}});
    return client;
  }

  Json get(const std::string& path) const {
    const auto reply = client().Get(path);
    if (!reply || reply->status != 200) return Json{{"status", reply ? reply->status : -1}};
    return Json::parse(reply->body);
  }

  std::atomic<int> stops_{0};
  Server server_;
  std::string address_, token_;
  int port_ = 0;
};

TEST_F(LiveServer, NothingWithoutTheToken) {
  server_.show(lookAt("cam1", 1));
  httplib::Client stranger(address_);
  for (const char* path : {"/", "/?token=", "/?token=00000000000000000000000000000000", "/state",
                           "/look?camera=cam1&stream=color"}) {
    EXPECT_EQ(statusOf(stranger.Get(path)), "403") << path;
  }
  EXPECT_EQ(statusOf(stranger.Post("/stop")), "403");
  // The token in the address opens the page and nothing else: what changes something needs the header, which
  // no foreign page can send.
  EXPECT_EQ(statusOf(stranger.Post("/stop?token=" + token_)), "403");
  EXPECT_EQ(stops_, 0);
  const auto page = stranger.Get("/?token=" + token_);
  ASSERT_EQ(statusOf(page), "200");
  EXPECT_NE(page->body.find("<button id=\"stop\""), std::string::npos);
  EXPECT_EQ(page->body.find("@NONCE@"), std::string::npos);
  EXPECT_NE(page->get_header_value("Content-Security-Policy").find("default-src 'none'"), std::string::npos);
}

TEST_F(LiveServer, RefusesAnotherHostName) {
  httplib::Client client(address_);
  const auto asked = [&](const std::string& host) {
    return statusOf(client.Get("/state", {{"Host", host}, {"X-Servocal-Token", token_}}));
  };
  EXPECT_EQ(asked("evil.example:" + std::to_string(port_)), "421");
  EXPECT_EQ(asked("localhost:" + std::to_string(port_)), "200");
}

TEST_F(LiveServer, StopIsTheOnlyControlAndNeedsAPost) {
  EXPECT_EQ(statusOf(client().Get("/stop")), "404");
  EXPECT_EQ(stops_, 0);
  for (const char* path : {"/state", "/look", "/start", "/"})
    EXPECT_NE(statusOf(client().Post(path)), "200") << path;
  EXPECT_EQ(statusOf(client().Post("/stop")), "200");
  EXPECT_EQ(stops_, 1);
}

TEST_F(LiveServer, StateTellsWhatTheRunTold) {
  EXPECT_EQ(get("/state")["eyes"].size(), 0u);
  server_.show(eventWith("one <b>&</b> \xff"));
  server_.show(lookAt("cam1", 1));
  const Json state = get("/state");
  EXPECT_EQ(state["cell"], "test cell");
  EXPECT_EQ(state["stage"], "cover");
  EXPECT_EQ(state["messages"][0]["at_s"], 7.0);
  ASSERT_EQ(state["eyes"].size(), 1u);
  EXPECT_EQ(state["eyes"][0]["sigma_mm"], 2.1);
  EXPECT_EQ(state["eyes"][0]["coverage"]["corners"], (std::vector<int>{12, 3}));
  EXPECT_EQ(state["eyes"][0]["coverage"]["unreachable"], (std::vector<bool>{false, true}));
  EXPECT_EQ(state["eyes"][0]["look"], 1);
  EXPECT_EQ(state["arm"]["speed_mmps"], 50.0);
  EXPECT_EQ(state["arm"]["frame_age_ms"], 65.0);
  EXPECT_EQ(state["arm"]["max_frame_age_ms"], 150.0);
  EXPECT_EQ(state["arm"]["twist"], (std::vector<double>{30, -40, 0, 0, 0, 0}));
  EXPECT_EQ(state["servo"]["error_px"][0], 12.35);
  EXPECT_EQ(state["servo"]["wanted_mmps"][0], 100.0);
  EXPECT_EQ(state["ending"], nullptr);
}

// What is commanded beside what is measured, and what the guard makes of it.
TEST_F(LiveServer, StateTellsTheGuardsVerdict) {
  procedure::Look look = lookAt("cam1", 1);
  server_.show(look);
  const Json guard = get("/state")["arm"]["guard"];
  EXPECT_EQ(guard["wanted"], (std::vector<double>{60, -80, 0, 0, 0, 5.73}));
  EXPECT_EQ(guard["applied"], (std::vector<double>{30, -40, 0, 0, 0, 2.86}));
  EXPECT_EQ(guard["rule"], "speed");
  EXPECT_EQ(guard["reason"], "Slowed down to the speed limits.");
  EXPECT_EQ(guard["refused"], false);
  EXPECT_EQ(guard["interventions"], (Json{{"speed", 12}, {"workspace", 1}}));
  EXPECT_EQ(guard["refused_at_s"], 0.4);
  EXPECT_EQ(guard["refused_reason"], "The board would leave the workspace.");
  look.arm.guard = {};  // Nothing is commanded.
  server_.show(look);
  const Json state = get("/state");
  EXPECT_EQ(state["arm"]["guard"]["wanted"], nullptr);
  EXPECT_EQ(state["arm"]["guard"]["refused_at_s"], nullptr);
  EXPECT_EQ(state["servo"]["wanted_mmps"][1], nullptr);
}

TEST_F(LiveServer, LooksAreTheNewestAndDecode) {
  EXPECT_EQ(get("/look?camera=cam1&stream=color")["status"], 404);
  server_.show(lookAt("cam1", 60));
  server_.show(lookAt("cam2", 120, 640, 480));
  server_.show(lookAt("cam1", 200));
  const auto grayOf = [&](const std::string& camera, int width_px) {
    const Json look = get("/look?camera=" + camera + "&stream=color");
    const std::string url = look["image"], head = "data:image/jpeg;base64,";
    EXPECT_EQ(url.substr(0, head.size()), head);
    // Decoded by another hand than encoded it.
    const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::vector<std::uint8_t> bytes;
    std::uint32_t bits = 0;
    int held = 0;
    for (std::size_t i = head.size(); i < url.size() && url[i] != '='; ++i) {
      bits = bits << 6 | static_cast<std::uint32_t>(digits.find(url[i]));
      if ((held += 6) < 8) continue;
      held -= 8;
      bytes.push_back(bits >> held & 255);
    }
    const cv::Mat image = cv::imdecode(bytes, cv::IMREAD_GRAYSCALE);
    EXPECT_EQ(image.cols, width_px);
    return image.empty() ? -1.0 : cv::mean(image)[0];
  };
  EXPECT_NEAR(grayOf("cam1", 960), 200, 2);
  EXPECT_NEAR(grayOf("cam2", 640), 120, 2);
  const Json look = get("/look?camera=cam1&stream=color");
  EXPECT_EQ(look["number"], 3);
  EXPECT_EQ(look["width_px"], 1920);
  EXPECT_EQ(look["corners"], (std::vector<double>{100, 200, 300, 400}));
  EXPECT_EQ(look["goal"].size(), 8u);
}

TEST_F(LiveServer, SixteenBitInfraredIsStretched) {
  procedure::Look look = lookAt("cam1", 0, 64, 48);
  look.frame.stream = Stream::kInfrared;
  look.frame.image = cv::Mat(48, 64, CV_16UC1, cv::Scalar(30000));
  look.frame.image.at<std::uint16_t>(0, 0) = 20000;
  server_.show(look);
  EXPECT_EQ(get("/look?camera=cam1&stream=infrared")["width_px"], 64);
  EXPECT_EQ(get("/look?camera=cam1&stream=color")["status"], 404);
}

/// Connects, asks for a large answer and never reads it.
int stalledClient(int port, const std::string& token) {
  const int socket_fd = socket(AF_INET, SOCK_STREAM, 0);
  const int small = 4096;
  setsockopt(socket_fd, SOL_SOCKET, SO_RCVBUF, &small, sizeof small);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  inet_pton(AF_INET, "127.0.0.1", &address.sin_addr);
  if (connect(socket_fd, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) return -1;
  const std::string request =
      "GET /look?camera=cam1&stream=color HTTP/1.1\r\nHost: localhost\r\nX-Servocal-Token: " + token +
      "\r\n\r\n";
  if (write(socket_fd, request.data(), request.size()) < 0) return -1;
  return socket_fd;
}

// Clients that stop reading cost the run nothing, and the button works for the others.
TEST_F(LiveServer, StalledClientsStopNeitherRunNorButton) {
  procedure::Look noisy = lookAt("cam1", 0, 960, 4000);  // an answer too large for any socket buffer
  cv::randu(noisy.frame.image, 0, 255);
  server_.show(noisy);
  std::vector<int> stalled;
  for (int i = 0; i < 12; ++i) {
    stalled.push_back(stalledClient(port_, token_));
    ASSERT_GE(stalled.back(), 0);
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  std::vector<double> took_s;
  for (int i = 0; i < 2000; ++i) {
    const auto begin = Steady::now();
    server_.show(noisy);
    if (i % 10 == 0) server_.show(eventWith("on it goes"));
    took_s.push_back(std::chrono::duration<double>(Steady::now() - begin).count());
  }
  std::nth_element(took_s.begin(), took_s.begin() + 1980, took_s.end());
  EXPECT_LT(took_s[1980], 0.001);
  const auto pressed = Steady::now();
  EXPECT_EQ(statusOf(client().Post("/stop")), "200");
  EXPECT_LT(std::chrono::duration<double>(Steady::now() - pressed).count(), 0.2);
  EXPECT_EQ(stops_, 1);
  for (const int socket_fd : stalled) close(socket_fd);
}

TEST_F(LiveServer, TheEndWaitsForNobodyIfNobodyWatches) {
  const auto begin = Steady::now();
  server_.finish(true, "Goal met.");
  EXPECT_LT(Steady::now() - begin, std::chrono::milliseconds(100));
}

TEST_F(LiveServer, TheEndReachesWhoeverWatches) {
  get("/state");
  std::thread watcher([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    EXPECT_EQ(get("/state")["ending"]["verdict"], "Goal met.");
  });
  const auto begin = Steady::now();
  server_.finish(true, "Goal met.");
  EXPECT_GT(Steady::now() - begin, std::chrono::milliseconds(80));
  EXPECT_LT(Steady::now() - begin, std::chrono::milliseconds(1500));
  watcher.join();
}

TEST_F(LiveServer, ATakenPortIsSaidSo) {
  ServerOptions options;
  options.port = port_;
  try {
    Server second(
        cell(), [] {}, options);
    FAIL() << "two servers at one port";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("is the port taken"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace servocal::live
