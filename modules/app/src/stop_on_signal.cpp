// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/app/stop_on_signal.h"

#include <signal.h>

#include <array>
#include <utility>

namespace servocal::app {
namespace {

constexpr std::array kStopping = {SIGINT, SIGTERM, SIGHUP};

std::function<void()> stop_;
volatile sig_atomic_t signals_ = 0;

void onSignal(int number) {
  if (signals_++ == 0) {
    stop_();
    return;
  }
  signal(number, SIG_DFL);
  raise(number);
}

}  // namespace

StopOnSignal::StopOnSignal(std::function<void()> stop) {
  stop_ = std::move(stop);
  signals_ = 0;
  signal(SIGPIPE, SIG_IGN);  // What is printed may be lost; the arm must be stopped and the session saved.
  for (const int number : kStopping) {
    struct sigaction action = {};
    sigaction(number, nullptr, &action);
    if (action.sa_handler == SIG_IGN) continue;
    action = {};
    action.sa_handler = onSignal;
    action.sa_flags = SA_RESTART;
    sigaction(number, &action, nullptr);
  }
}

StopOnSignal::~StopOnSignal() {
  for (const int number : kStopping) {
    struct sigaction action = {};
    sigaction(number, nullptr, &action);
    if (action.sa_handler == onSignal) signal(number, SIG_DFL);
  }
}

}  // namespace servocal::app
