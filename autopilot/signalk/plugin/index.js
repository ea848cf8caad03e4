// Signal K server plugin: hands on what `autopilot signalk` says, and is the provider of the server's autopilot API.
// One line of JSON each way: deltas come, PUT requests go, each answered. Node.js alone, no packages.
'use strict'

const net = require('net')

const DEVICE = 'norrbin'
const RETRY_MS = 2000
const ANSWER_MS = 10000
const LONGEST = 1 << 20
const STATE = 'steering.autopilot.state'
const TARGET = 'steering.autopilot.target.headingTrue'
const ADJUST = 'steering.autopilot.actions.adjustHeading'
const DODGE = 'steering.autopilot.actions.dodge'
const ACKNOWLEDGE = 'steering.autopilot.actions.acknowledge'
const NOTIFICATIONS = 'notifications.steering.autopilot.norrbin.'
const TARGET_MAGNETIC = 'steering.autopilot.target.headingMagnetic'
const OFF_LINE = 'off-line'
const STATES = [
  { name: 'auto', engaged: true },
  { name: 'route', engaged: true },
  { name: 'trial', engaged: true },
  { name: 'standby', engaged: false },
  { name: OFF_LINE, engaged: false }
]
const ORDERED = ['auto', 'route', 'standby']

module.exports = function (app) {
  let socket = null
  let retry = null
  let stopped = true
  let options = {}
  let received = ''
  let count = 0
  let isDodging = false
  let known = {}
  const waiting = new Map()
  const alarms = new Set()

  // ---- the line to `autopilot signalk`

  function connect() {
    received = ''
    socket = net.createConnection({ host: options.host || '127.0.0.1', port: options.port || 8376 })
    socket.setEncoding('utf8')
    socket.setKeepAlive(true, 5000)
    socket.on('connect', greet)
    socket.on('data', take)
    socket.on('error', (error) => app.setPluginError(`autopilot signalk: ${error.message}; trying again`))
    socket.on('close', gone)
  }

  // who has shown the token keeps its place while others come
  function greet() {
    app.setPluginStatus('connected to autopilot signalk')
    if (options.token) socket.write(JSON.stringify({ requestId: 'greeting', token: options.token }) + '\n')
  }

  function gone() {
    socket = null
    for (const { reject, timer } of waiting.values()) {
      clearTimeout(timer)
      reject(failure(503, 'the line to autopilot signalk is down'))
    }
    waiting.clear()
    if (stopped) return
    known = {}
    isDodging = false
    app.setPluginError('autopilot signalk is not there; trying again')
    tell({ [STATE]: OFF_LINE, 'steering.autopilot.engaged': false, [TARGET]: null })
    retry = setTimeout(connect, RETRY_MS)
  }

  function take(text) {
    received += text
    const lines = received.split('\n')
    received = lines.pop()
    if (received.length > LONGEST) return socket.destroy()
    for (const line of lines) {
      let message
      try {
        message = JSON.parse(line)
      } catch {
        return socket.destroy()
      }
      if (message.requestId !== undefined) answered(message)
      else if (Array.isArray(message.updates)) heard(message)
    }
  }

  function heard(delta) {
    const values = {}
    for (const update of delta.updates) for (const { path, value } of update.values || []) values[path] = value
    tell(values)
  }

  function tell(values) {
    Object.assign(known, values)
    if (!state().engaged) isDodging = false
    const changes = Object.entries(values).filter(([path]) => !isOurs(path)).map(([path, value]) => ({ path, value }))
    for (const { path } of changes) if (path.startsWith(NOTIFICATIONS)) watch(path)
    // apart: the server gives all of an update that has a notification in it another source
    for (const apart of [false, true]) {
      const group = changes.filter(({ path }) => path.startsWith('notifications.') === apart)
      if (group.length) app.handleMessage(plugin.id, { context: 'vessels.self', updates: [{ values: group }] })
    }
    if (STATE in values || TARGET in values) {
      app.autopilotUpdate(DEVICE, { state: state().name, mode: 'compass', target: target(), engaged: state().engaged, actions: actions() })
    }
  }

  // ---- alarms: who silences one by a PUT of version 1 acknowledges on board. The server's notifications API (v2) is not
  // heeded: signalk-server 2.23 lets everybody acknowledge there, signed in or not.

  function watch(path) {
    if (alarms.has(path)) return
    alarms.add(path)
    app.registerPutHandler('vessels.self', `${path}.method`, handler(silence))
    app.registerPutHandler('vessels.self', `${path}.state`, handler(never('way to end an alarm but to end its cause')))
  }

  async function silence(method) {
    if (!Array.isArray(method) || method.includes('sound')) throw failure(400, 'method: a list without sound is allowed')
    await acknowledge()
  }

  function acknowledge() {
    return put(ACKNOWLEDGE, true)
  }

  // what the autopilot API tells by itself
  function isOurs(path) {
    return path === STATE || path === 'steering.autopilot.engaged'
  }

  function answered(message) {
    const asked = waiting.get(message.requestId)
    if (!asked) return
    waiting.delete(message.requestId)
    clearTimeout(asked.timer)
    if (message.statusCode === 200) asked.resolve()
    else asked.reject(failure(message.statusCode, message.message || 'refused'))
  }

  function put(path, value) {
    if (!socket || socket.connecting) return Promise.reject(failure(503, 'autopilot signalk is not there'))
    const requestId = `${++count}`
    return new Promise((resolve, reject) => {
      const timer = setTimeout(() => {
        waiting.delete(requestId)
        reject(failure(504, 'the pilot does not answer'))
      }, ANSWER_MS)
      waiting.set(requestId, { resolve, reject, timer })
      socket.write(JSON.stringify({ requestId, token: options.token || '', put: { path, value } }) + '\n')
    })
  }

  function failure(statusCode, message) {
    return Object.assign(new Error(message), { statusCode, state: 'FAILED' })
  }

  // ---- what is known

  function state() {
    const name = known[STATE] || OFF_LINE
    return STATES.find((each) => each.name === name) || { name, engaged: false }
  }

  function target() {
    const value = known[TARGET]
    return typeof value === 'number' ? value : null
  }

  function actions() {
    return [{ id: 'dodge', name: 'Dodge', available: state().engaged }]
  }

  const degrees = (radians) => (radians * 180) / Math.PI
  const never = (what) => async () => {
    throw failure(400, `this pilot knows no ${what}`)
  }

  // ---- the autopilot API, version 2

  const provider = {
    getData: async () => ({
      options: { states: STATES, modes: ['compass'], actions: actions() },
      target: target(),
      mode: 'compass',
      state: state().name,
      engaged: state().engaged
    }),
    getState: async () => state().name,
    setState: async (value) => {
      if (!ORDERED.includes(value)) throw failure(400, `state: ${ORDERED.join(', ')} are allowed`)
      await put(STATE, value)
    },
    getMode: async () => 'compass',
    setMode: async (value) => {
      if (value !== 'compass') throw failure(400, 'mode: compass is allowed')
    },
    getTarget: async () => target(),
    setTarget: (value) => put(TARGET, value),
    adjustTarget: (value) => put(ADJUST, degrees(value)),
    engage: () => put(STATE, 'auto'),
    disengage: () => put(STATE, 'standby'),
    courseCurrentPoint: () => put(STATE, 'route'),
    courseNextPoint: never('way to skip a waypoint'),
    tack: never('tacking'),
    gybe: never('gybing'),
    dodge: async (value) => {
      if (value === null) {
        if (isDodging) await put(DODGE, null)
        isDodging = false
      } else {
        if (value !== 0) await put(DODGE, degrees(value))
        isDodging = value !== 0 || isDodging
      }
    }
  }

  // ---- PUT requests of version 1, as KIP and older programs send them

  function handler(order) {
    return (_context, _path, value, done) => {
      order(value).then(
        () => done({ state: 'COMPLETED', statusCode: 200 }),
        (error) => done({ state: 'COMPLETED', statusCode: error.statusCode || 500, message: error.message })
      )
      return { state: 'PENDING' }
    }
  }

  async function turnToMagnetic(value) {
    const variation = app.getSelfPath('navigation.magneticVariation.value')
    if (typeof value !== 'number' || typeof variation !== 'number') {
      throw failure(400, 'a magnetic heading needs navigation.magneticVariation; give headingTrue instead')
    }
    await put(TARGET, (value + variation) % (2 * Math.PI))
  }

  const plugin = {
    id: 'signalk-norrbin',
    name: 'Norrbin autopilot',
    description: 'State of a Norrbin autopilot as deltas, and orders from Signal K programs to it',
    schema: {
      type: 'object',
      properties: {
        host: { type: 'string', title: 'Address of autopilot signalk', default: '127.0.0.1' },
        port: { type: 'number', title: 'Port of autopilot signalk', default: 8376 },
        token: { type: 'string', title: 'Token, as in the file that autopilot signalk was given (empty: look only)', default: '' }
      }
    },
    start: (configuration) => {
      options = configuration || {}
      stopped = false
      app.registerAutopilotProvider(provider, [DEVICE])
      app.registerPutHandler('vessels.self', STATE, handler((value) => provider.setState(value)))
      app.registerPutHandler('vessels.self', TARGET, handler((value) => put(TARGET, value)))
      app.registerPutHandler('vessels.self', TARGET_MAGNETIC, handler(turnToMagnetic))
      app.registerPutHandler('vessels.self', ADJUST, handler((value) => put(ADJUST, value)))
      app.registerPutHandler('vessels.self', ACKNOWLEDGE, handler(acknowledge))
      connect()
    },
    stop: () => {
      stopped = true
      clearTimeout(retry)
      if (socket) socket.destroy()
    }
  }
  return plugin
}
